"""The joint method and the paper's on the same boxes, with the network for what they do not tell.

    python -m benchmarks.boxes_by_method [--data DIR] [--cache DIR] [--write]

Small parts of recordings with true cameras (those of benchmarks.coverage), the detector's boxes
alone, nothing given. Both methods get the same reading of the orientation network. With --write the
table replaces what stands between the markers in docs/coverage.md.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.coverage import Part, arguments_of, kept, markdown, on_ground, parts, put
from benchmarks.recordings import RECORDINGS, Recording

BEGIN, END = "<!-- methods: begin -->", "<!-- methods: end -->"
METHODS = ("joint", "paper")


def error_m(part: Part, method: str, recording: Recording) -> float:
    """Mean error on the ground after rigid alignment; NaN where the method refuses."""
    found = replace(part, options=replace(part.options, method=method)).solve()
    return on_ground(found, recording, part.segments)[1] if found else np.nan


def measured(data: Path, cache: Path) -> dict[str, np.ndarray]:
    """Errors (n, 2) of both methods on every part, by recording."""
    found = {}
    for make in RECORDINGS:
        recording, seen = kept(make, data, cache)
        if seen.reading is None:
            continue
        boxes = [
            part
            for part in parts(recording, seen)
            if part.given == "nothing" and part.kind.startswith("boxes")
        ]
        errors = [[error_m(part, method, recording) for method in METHODS] for part in boxes]
        found[recording.name] = np.array(errors)
    return found


def table(found: dict[str, np.ndarray]) -> list[list[str]]:
    head = ["", "parts", "refused: joint", "refused: paper", "median error: joint",
            "median error: paper", "mean: joint", "mean: paper", "joint is better"]  # fmt: skip
    lines = [head, ["---"] * len(head)]
    for name, errors in [*found.items(), ("**all**", np.concatenate([*found.values()]))]:
        refused = np.isnan(errors).sum(axis=0)
        both = errors[np.isfinite(errors).all(axis=1)]
        values = [*np.median(both, axis=0), *both.mean(axis=0)]
        better = f"{np.mean(both[:, 0] < both[:, 1]):.0%} of {len(both)}"
        lines.append(
            [name, str(len(errors)), *map(str, refused), *(f"{v:.2f} m" for v in values), better]
        )
    return lines


def main() -> None:
    arguments = arguments_of(__doc__).parse_args()
    text = markdown(table(measured(arguments.data, arguments.cache)))
    print(text)
    if arguments.write:
        put(text, BEGIN, END)


if __name__ == "__main__":
    main()
