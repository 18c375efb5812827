"""Is the orientation network worth having where a single frame shows a few people?

    python -m benchmarks.few_people [--data DIR]

DIR holds pets2009/ and towncentre/. People are drawn from single frames that the network has read;
the joint method calibrates them alone, and with the network's reading of that very frame, as
`scene4d calibrate` would; both again without the straight edges of the scene, which tell much the
same about the camera as the network does. Medians are of the mean correspondence error at people of
1.70 m over the cameras that were given. The draws of a recording share its scene and its camera:
they are far from independent.
"""

import numpy as np

from benchmarks import options_of
from benchmarks.tables import markdown
from scene4d.calibration import person_segments
from scene4d.calibration._guess import solve_guided
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen, watch
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.people import Segments
from scene4d.core.progress import Silent
from scene4d.evaluation import Reference, pets, towncentre
from scene4d.video.reader import open_source

PEOPLE = (3, 5, 10)
DRAWS = 24
HEADINGS = [
    "footage", "people", "draws", "refused without", "median without", "refused with",
    "median with", "both gave one", "median without", "median with", "closer with",
]  # fmt: skip
ALONE, GUIDED = CalibrateOptions(orientation="people"), CalibrateOptions(orientation="auto")


def error_m(found: Calibration, reference: Reference) -> float:
    """NaN where the camera was refused, infinite where it has a point above its horizon."""
    if not found or found.camera is None:
        return float("nan")
    try:
        return reference.score(found.camera).mean_m
    except InputError:
        return float("inf")


def draws(segments: Segments, people: int, frames: set[int]) -> list[np.ndarray]:
    """Rows of so many people of one frame: different draws, as many as there are up to DRAWS."""
    rng = np.random.default_rng(people)
    numbers, counts = np.unique(segments.frame, return_counts=True)
    enough = [n for n, count in zip(numbers, counts, strict=True) if count >= people]
    enough = [n for n in enough if int(n) in frames]
    drawn: dict[tuple[int, ...], np.ndarray] = {}
    for _ in range(4 * DRAWS if enough else 0):
        of_frame = np.flatnonzero(segments.frame == rng.choice(enough))
        rows = np.sort(rng.choice(of_frame, people, replace=False))
        drawn.setdefault(tuple(rows.tolist()), rows)
        if len(drawn) == DRAWS:
            break
    return list(drawn.values())


def lines(footage: str, seen: Seen, reference: Reference) -> list[list[str]]:
    """The rows of the table for one recording."""
    segments = person_segments(seen.detections)
    looked_at = {index for index, _ in seen.reading.by_frame}
    made = []
    size = seen.detections.image_size
    for way, edges in ((footage, seen.edges_xyxy), (f"{footage}, no edges", None)):
        for people in PEOPLE:
            errors = []
            for rows in draws(segments, people, looked_at):
                chosen = segments.select(rows)
                read = seen.reading.of_frame(int(chosen.frame[0]))
                alone = solve_guided(chosen, size, ALONE, None, edges_xyxy=edges)
                guided = solve_guided(chosen, size, GUIDED, read, edges_xyxy=edges, alone=alone)
                errors.append([error_m(found, reference) for found in (alone, guided)])
            if errors:
                made.append([way, f"{people}", *cells(*np.array(errors).T)])
    return made


def cells(alone_m: np.ndarray, guided_m: np.ndarray) -> list[str]:
    both = ~(np.isnan(alone_m) | np.isnan(guided_m))
    return [
        f"{len(alone_m)}", f"{np.isnan(alone_m).sum()}", median(alone_m),
        f"{np.isnan(guided_m).sum()}", median(guided_m), f"{both.sum()}",
        median(alone_m[both]), median(guided_m[both]),
        f"{(guided_m < alone_m)[both].sum()} of {both.sum()}",
    ]  # fmt: skip


def median(errors_m: np.ndarray) -> str:
    """Median of the cameras that were given; nothing where none was, or the middle one failed."""
    given = np.sort(errors_m[~np.isnan(errors_m)])
    middle = given[(len(given) - 1) // 2] if len(given) else np.inf
    return f"{middle:.2f} m" if np.isfinite(middle) else ""


def main() -> None:
    parser = options_of(__doc__)
    data = parser.parse_args().data
    rows = [HEADINGS]
    for footage, path, reference in (
        ("PETS 2009", data / "pets2009" / "vtest.avi", pets(data / "pets2009")),
        ("TownCentre", data / "towncentre" / "frames", towncentre(data / "towncentre")),
    ):
        with open_source(path) as source:
            seen = watch(source, CalibrateOptions(orientation="network"), Silent(), {})
        rows += lines(footage, seen, reference)
    print(markdown(rows))


if __name__ == "__main__":
    main()
