"""Plans of annotated clips, which need no network and no footage, and a stage that does little."""

import json
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from unittest.mock import patch

from scene4d.fleet import _stages as stages
from scene4d.fleet._store import Store
from walks import CAMERA, FPS, mot_text

CAMERAS = ("gate", "yard")
NODE = {"num_cpus": 1, "object_store_memory": 80 * 2**20, "memory": 2 * 10**9}
"""A machine of a cluster, as small as Ray lets it be."""


def head(cores: int):
    """A cluster on this machine, of its head alone."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))  # workers take what is here
    from ray.cluster_utils import Cluster

    args = NODE | {"num_cpus": cores, "include_dashboard": False}
    for _ in range(2):
        with suppress(Exception):  # Ray gives a machine 30 s to begin, and it may be busy
            return Cluster(True, head_node_args=args)
    return Cluster(True, head_node_args=args)


def boxes(folder: Path, clips: int = 2) -> Path:
    """A folder with clips of two cameras, and the camera's file."""
    CAMERA.save(folder / "camera.json")
    for camera in CAMERAS:
        (folder / camera).mkdir()
        for number in range(clips):
            text = mot_text(tracks=True).splitlines()
            kept = [line for line in text if int(line.partition(",")[0]) <= 30 - number]
            (folder / camera / f"{camera}-20261120T08{number:02d}00.txt").write_text(
                "\n".join(kept)
            )
    return folder


def plan(folder: Path, *more: str, camera: str = "camera.json") -> Path:
    """A plan that tracks them."""
    lines = ["cameras:"]
    for name in CAMERAS:
        lines += [f"  {name}:", f"    boxes: {name}/*.txt", f"    camera: {camera}"]
        lines += [f'    start: "{name}-%Y%m%dT%H%M%S"']
    lines += [f"track: {{fps: {FPS}, rate_hz: 5, format: mot}}", *more]
    path = folder / "plan.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def tiny_work(job, address):
    """What workers do, with a stage that takes a moment and tells who did it."""
    with patch.dict(stages._STAGES, track=_tiny):
        return stages.work(job, address)


def _tiny(job, store, scratch, out):
    text = job.task.clip.read_text()
    workers = job.task.clip.parents[1] / "workers"
    workers.mkdir(exist_ok=True)
    (workers / f"{job.task.clip.stem}.{os.getpid()}").touch()
    (out / "half.txt").write_text(text)
    if text.startswith("poison"):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.3)
    (out / "seen.txt").write_text(text)
    return 360.0


def results(store: Path) -> dict[str, bytes]:
    """All files of results that are done."""
    done = [json.loads(path.read_text())["path"] for path in (store / "done").glob("*.json")]
    files = (one for path in done for one in (store / path).rglob("*") if one.is_file())
    return {str(one.relative_to(store)): one.read_bytes() for one in files}


def left_half(store: Path) -> list[Path]:
    """Half results whose workers are gone; workers of a killed machine go a moment after it."""
    until = time.monotonic() + 30
    while True:
        Store(str(store)).sweep()
        left = list((store / ".half").glob("*/content"))
        if not left or time.monotonic() > until:
            return left
        time.sleep(0.2)


def nothing_work(job, address):
    """What workers do, with a stage that takes no time."""
    with patch.dict(stages._STAGES, track=_nothing):
        return stages.work(job, address)


def _nothing(job, store, scratch, out):
    (out / "seen.txt").write_text(job.result.key)
    return 1.0
