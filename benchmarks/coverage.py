"""Does the truth lie where the calibration says? Many small parts of recordings with true cameras.

    python -m benchmarks.coverage [--data DIR] [--cache DIR] [--write]

Every recording is watched once (kept under --cache) and calibrated from parts of it: a few of the
tracks, a few seconds, as keypoints and as boxes, with and without the lens. The table says, for
every parameter and for ground points, how often the truth lies inside the stated intervals, and
what was refused. DIR is by default $SCENE4D_DATA or ../shared/data. With --write the tables
replace what stands between the markers in docs/coverage.md.
"""

import argparse
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from scipy.stats import chi2, norm

from benchmarks import ROOT, options_of
from benchmarks.recordings import RECORDINGS, Recording
from scene4d.calibration import _solve, person_segments
from scene4d.calibration._guess import solve_guided
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Segments
from scene4d.evaluation import correspondence_error, spread_points

PAGE = ROOT / "docs" / "coverage.md"
BEGIN, END = "<!-- coverage: begin -->", "<!-- coverage: end -->"
LEVELS = (0.50, 0.80, 0.95)
TRACKS = (3, 5, 8, 12, 20)
SECONDS = (4.0, 8.0, 16.0)
DRAWS = 4
GOOD_M = 1.0
"""A camera that errs by less than this should not be refused."""
NAMES = ("focal length", "tilt", "roll", "height")


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a recording: which people, and what is given besides."""

    recording: str
    kind: str
    given: str
    segments: Segments
    seen: Seen
    options: CalibrateOptions

    def solve(self) -> Calibration:
        return solve_guided(
            self.segments,
            self.seen.detections.image_size,
            self.options,
            self.seen.reading if self.given != "lens" else None,
            edges_xyxy=self.seen.edges_xyxy if self.given != "lens" else None,
            image_bgr=self.seen.image_bgr,
        )


@dataclass(frozen=True, eq=False)
class Judged:
    """``z`` (4,) errors of :data:`NAMES` in sigmas, ``d2`` (k,) of ground points, error in metres
    after rigid alignment, and the one predicted; ``refused`` with what the error would have been.
    """

    part: Part
    refused: bool
    reason: str
    z: np.ndarray
    d2: np.ndarray
    error_m: float
    predicted_m: float


# --- parts ---------------------------------------------------------------------------------------


def parts(recording: Recording, seen: Seen) -> Iterator[Part]:
    """All parts of a recording, the same ones in every run."""
    for points in recording.points:
        people = seen.detections
        people = people.without_keypoints() if points == "boxes" else people
        segments = person_segments(people)
        for given in recording.given:
            options = CalibrateOptions(lens=recording.lens if "lens" in given else None)
            for kind, rows in drawn(segments, np.random.default_rng(0)):
                chosen = segments.select(rows)
                if len(chosen):
                    yield Part(recording.name, f"{points}, {kind}", given, chosen, seen, options)


def drawn(segments: Segments, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    yield "all", np.ones(len(segments), bool)
    names = np.unique(segments.track[segments.track >= 0])
    for count in TRACKS:
        if len(names) > count:
            for _ in range(DRAWS):
                some = rng.choice(names, count, replace=False)
                yield f"{count} tracks", np.isin(segments.track, some)
    time_s = segments.time_s
    if not np.isfinite(time_s).all() or len(time_s) == 0:
        return
    first, last = float(time_s.min()), float(time_s.max())
    for span in SECONDS:
        if last - first > 1.5 * span:
            for begin in rng.uniform(first, last - span, DRAWS):
                yield f"{span:g} s", (time_s >= begin) & (time_s <= begin + span)


# --- judging -------------------------------------------------------------------------------------


def judged(part: Part, recording: Recording) -> Judged:
    found = part.solve()
    refused = not found
    reason = found.reason or ""
    if refused:
        found = unrefused(part)
    if not found or found.camera is None or found.covariance is None:
        nothing = np.full(len(NAMES), np.nan)
        return Judged(part, True, reason, nothing, np.empty(0), np.inf, np.nan)
    z = errors(found, recording)
    d2, error_m, predicted_m = on_ground(found, recording, part.segments)
    return Judged(part, refused, reason, z, d2, error_m, predicted_m)


def unrefused(part: Part) -> Calibration:
    """What would have been answered if nothing were refused."""
    with (
        mock.patch.object(_solve.verdict, "refusal", lambda *_, **__: None),
        mock.patch.object(_solve.verdict, "standing", lambda *_: None),
        mock.patch.object(_solve.verdict, "MIN_PEOPLE", 1),
        mock.patch.object(_solve.verdict, "FOCAL_KNOWN", np.inf),
    ):
        return part.solve()


def errors(found: Calibration, recording: Recording) -> np.ndarray:
    """Errors of :data:`NAMES` in standard deviations; NaN where it was given."""
    assert found.camera is not None and found.covariance is not None
    true, here = recording.camera, found.camera
    gap = np.array(
        [
            np.log(here.focal_px / true.focal_px),
            here.tilt_rad - true.tilt_rad,
            here.roll_rad - true.roll_rad,
            np.log(here.height_m / true.height_m),
        ]
    )
    own = np.diag(found.covariance)[: len(NAMES)]
    sigma = np.sqrt(own + recording.truth_sigma**2)
    return np.where(own > 0, gap / np.where(sigma > 0, sigma, 1.0), np.nan)


def on_ground(
    found: Calibration, recording: Recording, segments: Segments
) -> tuple[np.ndarray, float, float]:
    """Squared errors of ground points in sigmas, in the camera's own frame; the mean error (m)
    after rigid alignment of the points; and the predicted one.
    """
    assert found.camera is not None
    feet = recording.feet_uv if len(recording.feet_uv) else segments.foot_uv
    true_xy, valid = in_own_frame(recording.camera, feet)
    feet, true_xy = feet[valid], true_xy[valid]
    if len(feet) < 3:
        return np.empty(0), np.nan, np.nan
    chosen = spread_points(true_xy, min(12, len(feet)))
    uv, true_xy = feet[chosen], true_xy[chosen]
    xy, ok = found.camera.locate(uv)
    if not ok.all():
        return np.full(len(uv), np.inf), np.inf, np.nan
    covariance, _ = found.ground_covariance(uv, from_camera=True)
    truth = replace(
        found,
        camera=recording.camera,
        covariance=np.diag(np.pad(recording.truth_sigma**2, (0, len(found.covariance) - 4))),
    )
    extra, _ = truth.ground_covariance(uv, from_camera=True)
    gap = xy - true_xy
    d2 = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(covariance + extra), gap)
    aligned, _ = found.ground_covariance(uv, aligned_over_uv=uv)
    predicted = float(np.sqrt(np.trace(aligned, axis1=1, axis2=2).mean()))
    known = not recording.truth_sigma.any()
    return d2, correspondence_error(xy, true_xy).mean_m if known else np.nan, predicted


def in_own_frame(camera: Camera, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ground points with the origin below the camera and the optical axis along +Y."""
    xy, valid = camera.locate(uv)
    ahead = camera.R[2, :2] / np.hypot(*camera.R[2, :2])
    right = np.array([ahead[1], -ahead[0]])
    xy = xy - camera.centre_m[:2]
    return np.column_stack([xy @ right, xy @ ahead]), valid


# --- tables --------------------------------------------------------------------------------------


def inside(found: list[Judged]) -> list[str]:
    """Cells: shares inside the intervals and root-mean-square z, for parameters and ground."""
    accepted = [j for j in found if not j.refused]
    cells = []
    for index in range(len(NAMES)):
        z = np.array([j.z[index] for j in accepted])
        cells.append(_shares(np.abs(z[np.isfinite(z)]), [norm.ppf((1 + p) / 2) for p in LEVELS]))
    d2 = np.concatenate([j.d2 for j in accepted] or [np.empty(0)])
    cells.append(_shares(np.sqrt(d2 / 2), [float(np.sqrt(chi2.ppf(p, 2) / 2)) for p in LEVELS]))
    return cells


def _shares(size: np.ndarray, bounds: list[float]) -> str:
    if len(size) == 0:
        return ""
    shares = " ".join(f"{100 * (size <= bound).mean():.0f}" for bound in bounds)
    return f"{shares} ({np.sqrt(np.mean(np.minimum(size, 20.0) ** 2)):.2f})"


def refusals(found: list[Judged]) -> str:
    good = [j for j in found if j.error_m < GOOD_M]
    lost = sum(j.refused for j in good)
    return f"{sum(j.refused for j in found)} ({lost} of {len(good)} good)"


def table(found: list[Judged], by: Callable[[Judged], str]) -> list[list[str]]:
    head = ["", "parts", "refused", *NAMES, "ground points", "error m", "predicted m"]
    rows = [head, ["---"] * len(head)]
    groups: dict[str, list[Judged]] = {}
    for j in found:
        groups.setdefault(by(j), []).append(j)
    for name, some in [*groups.items(), ("**all**", found)]:
        error = np.array([j.error_m for j in some if not j.refused and np.isfinite(j.error_m)])
        predicted = np.array([j.predicted_m for j in some if not j.refused])
        medians = [f"{np.median(x):.2f}" if len(x) else "" for x in (error, predicted)]
        rows.append([name, str(len(some)), refusals(some), *inside(some), *medians])
    return rows


def markdown(lines: Iterable[list[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def measured(data: Path, cache: Path, only: str = "") -> list[Judged]:
    found = []
    for make in RECORDINGS:
        recording, seen = kept(make, data, cache)
        if only in recording.name:
            found += [judged(part, recording) for part in parts(recording, seen)]
    return found


def kept(make: Any, data: Path, cache: Path) -> tuple[Recording, Seen]:
    """What a recording shows, watched once."""
    recording, watch = make(data)
    file = cache / f"{recording.name.replace(' ', '_')}.pickle"
    if not file.exists():
        cache.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(watch()))
    return recording, pickle.loads(file.read_bytes())


def arguments_of(doc: str | None) -> argparse.ArgumentParser:
    """The options of a benchmark over parts of recordings, which writes into the page."""
    parser = options_of(doc)
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "scene4d-recordings"
    )
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    return parser


def put(text: str, begin: str, end: str) -> None:
    """Replace what stands between two marks of the page."""
    before, rest = PAGE.read_text().split(begin)
    PAGE.write_text(f"{before}{begin}\n{text}\n{end}{rest.split(end)[1]}")


def main() -> None:
    parser = arguments_of(__doc__)
    parser.add_argument("--only", default="", help="recordings whose name holds this")
    parser.add_argument("--verbose", action="store_true", help="a line for every part")
    arguments = parser.parse_args()
    found = measured(arguments.data, arguments.cache, arguments.only)
    if arguments.verbose:
        for j in found:
            z = " ".join(f"{value:6.1f}" for value in j.z)
            said = "REFUSED " + j.reason[:60] if j.refused else ""
            p = j.part
            print(
                f"{p.recording:16} {p.given:8} {p.kind:24} z {z}  {j.error_m:6.2f} "
                f"({j.predicted_m:.2f}) d2 {np.median(j.d2) if len(j.d2) else np.nan:6.1f} {said}"
            )
    text = "\n\n".join(
        markdown(table(found, by))
        for by in (
            lambda j: j.part.recording,
            lambda j: j.part.kind,
            lambda j: j.part.kind.split(",")[0] + ", given " + j.part.given,
        )
    )
    print(text)
    if arguments.write:
        put(text, BEGIN, END)


if __name__ == "__main__":
    main()
