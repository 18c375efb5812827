"""scene4d beside what else there is: ``make bench``, or ``python -m benchmarks``."""

import argparse
import os
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("SCENE4D_DATA", ROOT.parent / "shared" / "data"))
"""The recordings."""


def options_of(doc: str | None) -> argparse.ArgumentParser:
    """The options of a benchmark over recordings; its docstring is the help."""
    parser = argparse.ArgumentParser(
        description=(doc or "").replace("%", "%%"),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--data", type=Path, default=DATA, metavar="DIR")
    return parser
