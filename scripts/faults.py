"""Kill, fill and spoil: python scripts/faults.py [--kills 20] [--seed 0]

``track``, ``watch`` and ``align`` run in processes of their own on small footage whose detections
are known (tests/walks.py), and are killed (SIGKILL) at random moments. After each kill what was
published must be readable; at the end ``track`` and ``align``, started again until they end, must
have written what an undisturbed run writes. Then the disk is full (files of bounded size), the
clock of the machine jumps, and published pieces are spoilt. Exit status 1 with the first thing that
is not so. On two cores 20 kills of each take about six minutes.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / name) for name in ("tests/tracking", "tests", "src")]

from scene4d.core.errors import Scene4DError  # noqa: E402
from scene4d.core.tables import read_table  # noqa: E402
from scene4d.store.query import Scene  # noqa: E402
from scene4d.store.site import Site  # noqa: E402
from site_worlds import Eye, place, seen, store, strolls  # noqa: E402
from walks import CAMERA, write_video  # noqa: E402

CHILD = """
import sys
sys.path[:0] = {paths!r}
import datetime, signal, time
if {clock_s}:
    ahead_s, wall, wall_ns = [0.0], time.time, time.time_ns
    signal.signal(signal.SIGUSR1, lambda *_: ahead_s.append({clock_s}))
    time.time = lambda: wall() + ahead_s[-1]
    time.time_ns = lambda: wall_ns() + int(ahead_s[-1] * 1e9)
    class Jumping(datetime.datetime):
        @classmethod
        def now(cls, tz=None):
            return cls.fromtimestamp(time.time(), tz)
    datetime.datetime = Jumping
from conftest import Perfect
import scene4d.perception.objects as objects, scene4d.calibration.watching as watching
objects.ObjectDetector.default = lambda **_: Perfect()
watching.fetch_weights = lambda *_, **__: None
from scene4d.cli import main
sys.argv = ["scene4d", *sys.argv[1:]]
main()
"""


def started(words: list, *, clock_s: float = 0.0, bytes_each: int | None = None):
    """The program with a perfect detector, as a process."""
    code = CHILD.format(paths=sys.path[:3], clock_s=clock_s)

    def limited() -> None:
        if bytes_each is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_each, bytes_each))

    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words), "--quiet"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=limited,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},  # which would be cut off there too
    )


def ended(words: list, **options) -> tuple[int, str, float]:
    begun_s = time.monotonic()
    process = started(words, **options)
    _, said = process.communicate(timeout=600)
    return process.returncode, said, time.monotonic() - begun_s


def check(fact: bool, what: str) -> None:
    if not fact:
        raise SystemExit(f"faults: {what}")


def whole(words: list) -> float:
    """Run to the end; how long it took."""
    code, said, took_s = ended(words)
    check(code == 0, f"{words[0]} ended with {code}: {said}")
    return took_s


def rows_of(scene: Path) -> dict:
    """All rows, by column, as bytes."""
    tracks = Scene.open(scene).tracks()
    return {name: values.tobytes() for name, values in tracks.columns().items()}


def readable(scene: Path) -> int:
    """Rows of what is published; raises where that is no whole scene."""
    if not any((scene / "runs").glob("*.json")):
        return 0
    opened = Scene.open(scene)
    check(len(opened.tracks()) == len(opened), f"{scene}: the manifest promises other rows")
    return len(opened)


def kill_track(place: Path, kills: int, rng: random.Random) -> None:
    """Killed again and again, and each time started again."""
    video, camera = footage(place, 90)
    words = ["track", video, "--camera", camera, "--name", "yard", "--out"]
    took_s = whole([*words, place / "quiet"])
    done = 0
    while done < kills:
        scene = place / "killed"
        shutil.rmtree(scene, ignore_errors=True)
        for _ in range(4):  # four kills of one run, then the end
            process = started([*words, scene])
            time.sleep(rng.uniform(0.2, took_s))
            process.kill()
            process.communicate()
            readable(scene)
            done += 1
        whole([*words, scene])
        check(rows_of(scene) == rows_of(place / "quiet"), "track: resumed is not undisturbed")
        left = [path.name for path in scene.rglob(".*.tmp")]
        check(not left, f"track: left {left}")
    print(f"track: {done} kills, resumed runs equal the undisturbed one")


def kill_watch(place: Path, kills: int, rng: random.Random) -> None:
    """Each start is a run of its own, and what one published stays."""
    video, camera = footage(place, 30)
    scene, rows = place / "watched", 0
    for _ in range(kills):
        words = [
            "watch",
            video,
            "--camera",
            camera,
            "--out",
            scene,
            "--search",
            "person disappears",
        ]
        process = started(words)
        before, until_s = count_runs(scene), time.monotonic() + 60
        if rng.random() < 0.7:  # after its first second was published; else before, or about then
            while count_runs(scene) == before and time.monotonic() < until_s:
                time.sleep(0.05)
        time.sleep(rng.uniform(0.0, 5.0))
        process.kill()
        process.communicate()
        now = readable(scene)
        check(now >= rows, f"watch: {rows} rows were there, and are {now}")
        rows = now
        for path in (scene / "events").glob("*.jsonl"):
            for line in path.read_text().splitlines()[:-1]:
                json.loads(line)
    check(rows > 0, "watch: nothing was published")
    print(f"watch: {kills} kills, {rows} rows stay")


def count_runs(scene: Path) -> int:
    return len(list((scene / "runs").glob("*.json")))


def kill_align(place: Path, kills: int, rng: random.Random) -> None:
    """A site is there whole or not at all."""
    scenes = two_scenes(place)
    words = ["align", *scenes, "--out"]
    took_s = whole([*words, place / "site-quiet"])
    site, there = place / "site-killed", 0
    for _ in range(kills):
        process = started([*words, site])
        time.sleep(rng.uniform(0.5, took_s * 1.05))
        process.kill()
        process.communicate()
        if (site / "site.json").exists():
            there += 1
            Site.open(site).tracks(begin=0.0, end=20.0)
    whole([*words, site])
    told = [place_of(folder) for folder in (place / "site-quiet", site)]
    check(told[0] == told[1], "align: the site after kills is another one")
    print(f"align: {kills} kills, {there} left a site, which was whole; the last equals the first")


def place_of(folder: Path) -> tuple:
    said = json.loads((folder / "site.json").read_text())
    table = read_table(folder / said["identities"])
    return said["cameras"], {name: values.tolist() for name, values in table.items()}


def two_scenes(place_: Path) -> list[Path]:
    eyes = [
        Eye("west", place(0.0, 0.0, 0.0), (-4.0, 0.0), 12.0, 0.1, 0.1),
        Eye("east", place(30.0, 4.0, 160.0, 1.05, 7.3), (4.0, 0.0), 12.0, 0.2, 0.15),
    ]
    walkers = strolls(12, 120.0, 8.0)
    for eye in eyes:
        store(place_ / eye.name, eye, seen(eye, walkers)[0])
    return [place_ / eye.name for eye in eyes]


def fill_disk(place: Path) -> None:
    """Files of bounded size: one error and no traceback, and what was published stays."""
    video, camera = footage(place, 30)
    scene = place / "full"
    for words in (
        ["track", video, "--camera", camera, "--out", scene],
        ["watch", video, "--camera", camera, "--out", scene],
        ["align", *two_scenes(place), "--out", place / "site-full"],
    ):
        for size in (100, 2_000, 20_000):
            code, said, _ = ended(words, bytes_each=size)
            check(code in (0, 1), f"{words[0]} on a full disk ended with {code}: {said}")
            check("Traceback" not in said, f"{words[0]} on a full disk: {said}")
            readable(scene)
            if (place / "site-full" / "site.json").exists():
                Site.open(place / "site-full")
        print(f"{words[0]}: a full disk is one error")


def jump_clock(place: Path) -> None:
    """An hour forwards and an hour back while watching: times of rows go on."""
    video, camera = footage(place, 30)
    for jump_s in (3600.0, -3600.0):
        scene = place / f"clock{jump_s:.0f}"
        process = started(["watch", video, "--camera", camera, "--out", scene], clock_s=jump_s)
        until_s = time.monotonic() + 120
        while not count_runs(scene) and time.monotonic() < until_s:
            time.sleep(0.1)
        process.send_signal(signal.SIGUSR1)
        time.sleep(4)
        process.terminate()
        _, said = process.communicate(timeout=60)
        check(process.returncode in (0, 130), f"watch with a jump of {jump_s} s: {said}")
        begin, end = Scene.open(scene).runs[0].span_s
        check(0 < end - begin < 60, f"watch: a jump of {jump_s} s made a span of {end - begin} s")
    print("watch: jumps of the clock do not reach the rows")


def spoil_pieces(place: Path, rng: random.Random) -> None:
    """A spoilt piece is named; the pieces of other runs are still read."""
    video, camera = footage(place, 30)
    scene = place / "spoilt"
    for name in ("a", "b"):
        shutil.copy(video, place / f"{name}.avi")
        whole(["track", place / f"{name}.avi", "--camera", camera, "--out", scene])
    one = next((scene / "tracks" / "camera=a").rglob("*.parquet"))
    good = one.read_bytes()
    for _ in range(50):
        bad = bytearray(good)
        at = rng.randrange(len(bad))
        bad[at] ^= 1 << rng.randrange(8)
        one.write_bytes(bytes(bad[: rng.choice([len(bad), at])]))
        try:
            Scene.open(scene).tracks()
        except Scene4DError as error:
            check(one.name in str(error), f"a spoilt piece is not named: {error}")
        else:
            raise SystemExit("faults: a spoilt piece was read")
        check(len(Scene.open(scene).tracks(cameras=["b"])) > 0, "the other run is gone")
    print("pieces: 50 spoilt ones were named, others were read")


def footage(place: Path, seconds: int) -> tuple[Path, Path]:
    video, camera = place / f"yard{seconds}.avi", place / "camera.json"
    if not video.exists():
        write_video(video, seconds=seconds)
        CAMERA.save(camera)
    return video, camera


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--only", default="", help="one of the parts, as kill_track")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = random.Random(given.seed)
    kills = given.kills
    parts = {
        "spoil_pieces": lambda here: spoil_pieces(here, rng),
        "fill_disk": fill_disk,
        "kill_align": lambda here: kill_align(here, kills, rng),
        "kill_track": lambda here: kill_track(here, kills, rng),
        "kill_watch": lambda here: kill_watch(here, kills, rng),
        "jump_clock": jump_clock,
    }
    for part, work in parts.items():
        if part.startswith(given.only):
            with tempfile.TemporaryDirectory(prefix="scene4d-faults-") as name:
                work(Path(name))


if __name__ == "__main__":
    main()
