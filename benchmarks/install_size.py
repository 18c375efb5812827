"""How much room a default installation takes: python benchmarks/install_size.py

A fresh environment gets scene4d with its runtime dependencies at the versions of constraints.txt;
the sizes are those of the files that each distribution lists in its RECORD. The limit holds for
what the wheels bring; the byte code that pip adds unless told not to is shown beside it. Of the
environment's own pip and setuptools nothing is counted.
"""

import csv
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIMIT_MB = 800
NOT_OURS = {"pip", "setuptools"}


def install(folder: Path) -> None:
    """Make an environment in `folder` and install this checkout into it, as a user would."""
    venv.create(folder, with_pip=True)
    # The working folder is the root: pip splits paths in these variables at spaces.
    constraints = {"PIP_CONSTRAINT": "constraints.txt", "PIP_BUILD_CONSTRAINT": "constraints.txt"}
    pip = [str(folder / "bin" / "python"), "-m", "pip", "--quiet", "install", "--compile"]
    for what in ("pip", "."):
        subprocess.run([*pip, what], cwd=ROOT, env=os.environ | constraints, check=True)


def sizes_mb(folder: Path) -> dict[str, tuple[float, float]]:
    """Megabytes (10^6 bytes) by distribution: (files of the wheel, byte code)."""
    sizes = {}
    for record in folder.glob("lib/python*/site-packages/*.dist-info/RECORD"):
        name, version = record.parent.name.removesuffix(".dist-info").rsplit("-", 1)
        if name in NOT_OURS:
            continue
        total = {True: 0, False: 0}
        with record.open(newline="", encoding="utf-8") as lines:
            for path, *_ in csv.reader(lines):
                size = (record.parents[1] / path).stat().st_size
                total[path.endswith(".pyc")] += size
        sizes[f"{name} {version}"] = (total[False] / 1e6, total[True] / 1e6)
    return sizes


def main() -> int:
    """Print the table; 1 if the limit is broken."""
    with tempfile.TemporaryDirectory(prefix="scene4d-size-") as name:
        install(Path(name))
        sizes = sizes_mb(Path(name))
    row = "{:40}{:>10.1f}{:>12.1f}".format
    print(f"{'distribution':40}{'files, MB':>10}{'.pyc, MB':>12}")
    for title, (files, byte_code) in sorted(sizes.items(), key=lambda item: -item[1][0]):
        print(row(title, files, byte_code))
    files, byte_code = (sum(column) for column in zip(*sizes.values(), strict=True))
    print(row(f"total of {len(sizes)}", files, byte_code))
    print(f"without .pyc {files:.1f} MB, with .pyc {files + byte_code:.1f} MB")
    if files > LIMIT_MB:
        print(f"over the limit of {LIMIT_MB} MB", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
