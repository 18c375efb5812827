"""How fast ``track`` is, beside an earlier commit: python -m benchmarks.throughput

    [--data DIR] [--footage VIDEO CAMERA] [--commit b36787f] [--seconds 20] [--rounds 2]
    [--rates 10 5 2]

The first seconds of a video (PETS with its true camera) are tracked by both, in turns and each in
a process of its own, so that whatever else the machine does falls on both alike. Times are those of
the whole command, start included, its modules compiled before; processor time counts all threads.
The last table says how much longer detecting takes than the networks alone need within it, for this
checkout: each in seconds on the clock, of threads side by side.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import av
import numpy as np

from benchmarks import ROOT, options_of
from benchmarks.tables import Rows, machine, markdown

SHORT_S = 1.0
STAGES = ("detect people", "detect vehicles", "keypoints", "appearance")
CHILD = """
import json, sys, time
begun = time.perf_counter()
inside = 0.0
def watched(kind):
    plain = kind.run
    def run(self, *given, **more):
        global inside
        begun = time.perf_counter()
        found = plain(self, *given, **more)
        inside += time.perf_counter() - begun
        return found
    kind.run = run
from scene4d.cli import main
try:
    from scene4d.perception import _session
    watched(_session._Vino)
    watched(_session.ort.InferenceSession)
except (ImportError, AttributeError):
    pass  # an earlier commit
video, camera, out, rate = sys.argv[1:]
sys.argv = ["scene4d", "track", video, "--camera", camera, "--out", out, "--rate", rate, "--json"]
try:
    main()
except SystemExit as ended:
    assert not ended.code, ended.code
wall = time.perf_counter() - begun
print()
print(json.dumps({"networks": inside, "wall": wall, "processor": time.process_time()}))
"""


def cut(video: Path, seconds: float, out: Path) -> int:
    """The video's beginning, as it is encoded; the number of frames."""
    with av.open(str(video)) as source, av.open(str(out), "w") as target:
        stream = source.streams.video[0]
        copy = target.add_stream_from_template(stream)
        count = 0
        for packet in source.demux(stream):
            if packet.dts is None or float(packet.pts * stream.time_base) >= seconds:
                break
            packet.stream = copy
            target.mux(packet)
            count += 1
    return count


def tracked(code: Path, video: Path, camera: Path, rate: float, compiled: Path) -> dict:
    """One run of ``track`` by the package in the folder ``code``; ``compiled`` keeps bytecode."""
    with tempfile.TemporaryDirectory() as scratch:
        command = [sys.executable, "-c", CHILD, str(video), str(camera), scratch, str(rate)]
        paths = [str(code / "src"), os.environ.get("PYTHONPATH", "")]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
        environment |= {"PYTHONPYCACHEPREFIX": str(compiled)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        done = subprocess.run(
            command, env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
    said, _, times = done.stdout.rstrip().rpartition("\n")
    return json.loads(said) | json.loads(times)


def compared(before: Path, video: Path, camera: Path, rate: float, asked) -> tuple[Rows, list]:
    runs: dict[str, list[dict]] = {"before": [], "now": []}
    compiled = before.with_name("compiled")
    for _ in range(asked.rounds):
        for name, code in (("before", before), ("now", ROOT)):
            runs[name].append(tracked(code, video, camera, rate, compiled))
    rows: Rows = []
    for what in ("wall", "processor"):
        then, now = (np.median([r[what] for r in runs[name]]) for name in ("before", "now"))
        rows.append(
            [f"{rate:g} Hz", f"{what} time", f"{then:.1f} s", f"{now:.1f} s",
             f"{then / now:.2f}", f"{asked.seconds / now:.1f}"]
        )  # fmt: skip
    return rows, runs["now"]


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--footage", type=Path, nargs=2, metavar=("VIDEO", "CAMERA"))
    parser.add_argument("--commit", default="b36787f")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--rates", type=float, nargs="+", default=[10.0, 5.0, 2.0])
    asked = parser.parse_args()
    pets = asked.data / "pets2009"
    footage, camera = asked.footage or (pets / "vtest.avi", pets / "View_001.xml")
    print(machine())
    with tempfile.TemporaryDirectory() as scratch:
        before, video = Path(scratch) / "before", Path(scratch) / f"cut{footage.suffix}"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(before), asked.commit], check=True,
                       capture_output=True)  # fmt: skip
        try:
            short = Path(scratch) / f"short{footage.suffix}"
            cut(footage, SHORT_S, short)
            for code in (before, ROOT):
                tracked(code, short, camera, asked.rates[0], before.with_name("compiled"))
            frames = cut(footage, asked.seconds, video)
            times: Rows = [["rate", "of the command", asked.commit, "now", "ratio", "x real time"]]
            inside: Rows = [["rate", "stages", "networks alone", "ratio", *STAGES]]
            for rate in asked.rates:
                rows, now = compared(before, video, camera, rate, asked)
                times += rows
                for run in now[-1:]:
                    each = [run["timings_s"].get(name, 0.0) for name in STAGES]
                    alone = run["networks"]
                    inside.append(
                        [f"{rate:g} Hz", f"{sum(each):.1f} s", f"{alone:.1f} s",
                         f"{sum(each) / alone:.2f}", *(f"{s:.1f} s" for s in each)]
                    )  # fmt: skip
                    print(f"{frames} frames at {rate:g} Hz: tracks {run['tracks']}", flush=True)
        finally:
            subprocess.run([*git, "remove", "--force", str(before)], check=True)
    print(f"\n{markdown(times)}\n\n{markdown(inside)}")


if __name__ == "__main__":
    main()
