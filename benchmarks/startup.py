"""How long it takes until something can begin."""

import statistics
import subprocess
import sys
import time

from benchmarks.tables import Rows

COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "import scene4d": ["-c", "import scene4d"],
    "scene4d --help": ["-c", "from scene4d.cli import main; main()", "--help"],
}


def table(repeats: int) -> Rows:
    """Medians of fresh processes, in turns, so that a busy moment hits all of them."""
    seconds: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(repeats + 1):
        for name, arguments in COMMANDS.items():
            begun = time.perf_counter()
            subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
            seconds[name].append(time.perf_counter() - begun)
    # The first round reads files from the disk.
    medians = {name: statistics.median(taken[1:]) for name, taken in seconds.items()}
    least = medians["python -c pass"]
    rows = [["command", "s", "ratio"]]
    return rows + [[f"`{n}`", f"{s:.3f}", f"{s / least:.1f}"] for n, s in medians.items()]
