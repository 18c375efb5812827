"""``watch`` and ``serve`` for an hour: python scripts/soak.py [--minutes 60]

The ``--clip`` (by default that of the demo, with its ``--camera``) is played again and again.
Beside it ``serve`` answers as a browser asks: the page's data and the newest rows each five
seconds, a search each minute. For each third of the time: resident memory and open files of both
processes, and how long answers took. Memory of ``watch`` and files of both must be flat: the last
third within a tenth (or 30 MB, or 5 files) of the middle one. Exit status 1 where they are not.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.watching import looped  # noqa: E402

DEMO = ROOT / "scene4d-demo"
STEP_S, SEARCH_S = 5.0, 60.0
SEARCH = "a person walks for more than 2 seconds"


def program(*words: object) -> subprocess.Popen:
    code = "from scene4d.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def memory_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def files_of(pid: int) -> float:
    return float(len(list(Path(f"/proc/{pid}/fd").iterdir())))


def answered_s(address: str, body: dict | None = None) -> float:
    """Seconds until the whole answer is here."""
    content = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(address, content, {"Content-Type": "application/json"})
    begun_s = time.monotonic()
    with urllib.request.urlopen(request, timeout=120) as reply:
        reply.read()
    return time.monotonic() - begun_s


def newest(address: str, span_s: float = 10.0) -> str | None:
    """The address of the last rows of the newest run; None while nobody was tracked."""
    with urllib.request.urlopen(f"{address}api/scene", timeout=120) as reply:
        runs = json.load(reply)["runs"]
    if not runs:
        return None
    since_s = max(0.0, runs[-1]["end_s"] - span_s)
    return f"{address}api/runs/{runs[-1]['number']}/rows?since_s={since_s}"


def soak(scene: Path, watching: subprocess.Popen, seconds: float) -> list[dict[str, float]]:
    """What was measured, in steps, from when somebody was tracked."""
    serving, address = served(scene)
    try:
        measured, searched_s = [], -SEARCH_S
        begun_s = time.monotonic()
        while (now_s := time.monotonic() - begun_s) < seconds and watching.poll() is None:
            rows = newest(address)
            if rows is None:
                time.sleep(1.0)
                continue
            step = {"scene": answered_s(f"{address}api/scene"), "rows": answered_s(rows)}
            if now_s - searched_s >= SEARCH_S:
                searched_s = now_s
                step["search"] = answered_s(f"{address}api/search", {"words": SEARCH})
            for name, process in (("watch", watching), ("serve", serving)):
                step[f"{name} memory"] = memory_mb(process.pid)
                step[f"{name} files"] = files_of(process.pid)
            measured.append(step)
            time.sleep(max(0.0, STEP_S - (time.monotonic() - begun_s - now_s)))
        return measured
    finally:
        serving.send_signal(signal.SIGTERM)
        serving.communicate(timeout=60)


def served(scene: Path) -> tuple[subprocess.Popen, str]:
    """A server and its address; nobody needs to be tracked yet."""
    scene.mkdir(exist_ok=True)
    serving = program("serve", scene, "--port", 0)
    said = serving.stderr.readline()
    address = said.partition("serving at ")[2].partition(" ")[0]
    if not address:
        raise SystemExit(f"soak: nothing is served: {said}{serving.stderr.read()}")
    return serving, address


def thirds(measured: list[dict[str, float]]) -> dict[str, list[float]]:
    """The median of each third, by name."""
    size = len(measured) // 3
    found = {}
    for name in ("watch memory", "watch files", "serve memory", "serve files",
                 "scene", "rows", "search"):  # fmt: skip
        parts = [[s[name] for s in measured[k * size : (k + 1) * size] if name in s]
                 for k in range(3)]  # fmt: skip
        found[name] = [statistics.median(part) if part else float("nan") for part in parts]
    return found


def grown(found: dict[str, list[float]]) -> list[str]:
    """What is not flat."""
    bad = []
    for name, least in (("watch memory", 30.0), ("watch files", 5.0), ("serve files", 5.0)):
        _, middle, last = found[name]
        if not last <= middle + max(0.1 * middle, least):
            bad.append(f"{name} grew from {middle:.0f} to {last:.0f}")
    return bad


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--clip", type=Path, default=DEMO / "pets.avi")
    parser.add_argument("--camera", type=Path, default=DEMO / "camera.json")
    parser.add_argument("--rate", type=float, default=2.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="scene4d-soak-") as name:
        place = Path(name)
        video = looped(given.clip, 60 * given.minutes + 120, place / "looped.mkv")
        words = ["--camera", given.camera, "--out", place / "scene", "--rate", given.rate]
        watching = program("watch", video, *words, "--search", "two people meet", "--quiet")
        try:
            measured = soak(place / "scene", watching, 60 * given.minutes)
        finally:
            watching.send_signal(signal.SIGTERM)
            _, said = watching.communicate(timeout=120)
    if watching.returncode not in (0, 130) or "Traceback" in said:
        raise SystemExit(f"soak: watch ended with {watching.returncode}: {said}")
    found = thirds(measured)
    print(f"{given.minutes:g} minutes, {len(measured)} steps of {STEP_S:g} s")
    for what, values in found.items():
        unit = {"memory": "MB", "files": "files"}.get(what.split()[-1], "ms")
        scale = 1000 if unit == "ms" else 1
        print(f"{what:14}", *(f"{scale * value:8.0f} {unit}" for value in values))
    bad = grown(found)
    print("flat" if not bad else "; ".join(bad))
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
