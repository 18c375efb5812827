"""What each part of the method is worth: error with one thing changed at a time.

    python -m benchmarks.ablation [--data DIR] [--write]

DIR holds pets2009/, towncentre/ and meva/ (by default $SCENE4D_DATA or ../shared/data). With
--write the tables replace what stands between the markers in docs/ablation.md.
"""

import contextlib
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks import ROOT, options_of
from benchmarks.recordings import Recording, meva
from scene4d.calibration import _body as body
from scene4d.calibration import _joint as joint
from scene4d.calibration import _prior as prior
from scene4d.calibration import _refine as refine
from scene4d.calibration import _solve as solve
from scene4d.calibration import person_segments, solve_segments
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen, watch
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera, Lens
from scene4d.core.people import Detections, Segments
from scene4d.core.progress import Silent
from scene4d.evaluation import Reference, correspondence_error, pets, spread_points, towncentre
from scene4d.formats.annotations import read_annotations
from scene4d.video.frames import Frame, Source, Timeline
from scene4d.video.reader import open_source

PAGE = ROOT / "docs" / "ablation.md"
BEGIN, END = "<!-- ablation: begin -->", "<!-- ablation: end -->"
MEVA_CAMERAS = ("G328", "G341", "G424", "G506")
DRAWN = 100
"""Cameras drawn from what is known of a true one."""
THIRDS, THIRD_STEP = 3, 4
COUNTS = (1, 2, 5, 20, 100)
DRAWS = {1: 12, 2: 12, 5: 8, 20: 4, 100: 2}


@dataclass(frozen=True, eq=False)
class Case:
    """People of one camera; ``score`` gives the rms error and the predicted one in metres,
    ``true_to_m`` is the error that the true camera itself may have.
    """

    name: str
    segments: Segments
    image_size: tuple[int, int]
    score: Callable[[Calibration], tuple[float, float | None]]
    lens: Lens | None = None
    edges: np.ndarray | None = None
    true_to_m: float | None = None

    def solve(self, **changed: object) -> Calibration:
        options = CalibrateOptions(orientation="people", lens=self.lens, **changed)
        edges = self.edges if options.lines else None
        return solve_segments(self.segments, self.image_size, options, edges_xyxy=edges)


@dataclass(frozen=True)
class Variant:
    """One thing changed: options of the solver, constants of the model, or the people."""

    name: str
    arguments: dict[str, object] = field(default_factory=dict)
    constants: tuple[tuple[object, str, object], ...] = ()
    people: Callable[[Segments], Segments] = lambda segments: segments
    concerns: Callable[[Case], bool] = lambda case: True

    def solve(self, case: Case) -> Calibration | None:
        if not self.concerns(case):
            return None
        with contextlib.ExitStack() as stack:
            for place, name, value in self.constants:
                stack.enter_context(mock.patch.object(place, name, value))
            changed = replace(case, segments=self.people(case.segments))
            return changed.solve(**self.arguments)


def without_tracks(segments: Segments) -> Segments:
    return replace(segments, track=np.full(len(segments), -1))


def has_tracks(case: Case) -> bool:
    return bool((case.segments.track >= 0).any())


def has_boxes(case: Case) -> bool:
    return bool(case.segments.from_box.any())


VARIANTS = (
    Variant("as shipped"),
    Variant(
        "no body model",
        constants=((body, "BODY_RADIUS_M", 0.0), (body, "HEAD_RADIUS_M", 0.0)),
        concerns=has_boxes,
    ),
    Variant(
        "no tracks",
        people=without_tracks,
        concerns=has_tracks,
    ),
    Variant(
        "one height for all",
        constants=((refine, "_HEIGHT_RANGE", (1e-4, 1e-4)),),
        concerns=has_tracks,
    ),
    Variant(
        "every sighting counts",
        constants=((joint, "NEW_POSITION", 0.0), (solve, "TRACK_CORRELATION", 0.0)),
        concerns=has_tracks,
    ),
    Variant("no prior", constants=((prior, "_SIGMA", 100 * prior._SIGMA),)),
    Variant(
        "no edges",
        {"lines": False},
        concerns=lambda case: case.edges is not None,
    ),
    Variant(
        "no distortion",
        {"estimate_distortion": False},
        concerns=lambda case: case.lens is None,
    ),
    Variant(
        "feet at Z = 0",
        {"foot_height_m": 0.0},
        concerns=lambda case: not has_boxes(case),
    ),
)


# --- the cases -----------------------------------------------------------------------------------


def seen_in(source: Source) -> Seen:
    return watch(source, CalibrateOptions(frames=10**9), Silent(), {})


def of_footage(name: str, seen: Seen, reference: Reference, lens: Lens | None = None) -> Case:
    return Case(
        name,
        person_segments(seen.detections),
        reference.image_size,
        lambda found: (reference.score(found.camera).rms_m, reference.predicted_m(found)),
        lens,
        seen.edges_xyxy,
    )


def of_boxes(name: str, detections: Detections, reference: Reference) -> Case:
    return Case(
        name,
        person_segments(detections.without_keypoints()),
        reference.image_size,
        lambda found: (reference.score(found.camera).rms_m, reference.predicted_m(found)),
        reference.camera.lens,
    )


def annotated(path: Path, reference: Reference) -> Detections:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return read_annotations(path, image_size=reference.image_size, drop_invalid=True)


def boxes_of_actors(name: str, data: Path) -> Case:
    """Boxes of labelled actors of MEVA, the lens given."""
    recording, read = meva(name, data)
    segments, true = person_segments(read().detections), recording.camera
    known = true_to_m(recording, segments.foot_uv)
    return Case(
        f"{recording.name}, true to {known:.1f} m",
        segments,
        true.image_size,
        lambda found: (error_without_scale(found.camera, true, segments.foot_uv), None),
        true.lens,
        true_to_m=known,
    )


def true_to_m(recording: Recording, feet_uv: np.ndarray) -> float:
    """Rms error (m) of cameras that are drawn from what is known of the true one."""
    rng, true, errors = np.random.default_rng(0), recording.camera, []
    for _, tilt, roll, log_height in rng.normal(0, recording.truth_sigma, (DRAWN, 4)):
        drawn = Camera.from_pose(
            image_size=true.image_size,
            focal_px=true.focal_px,
            tilt_rad=true.tilt_rad + tilt,
            roll_rad=true.roll_rad + roll,
            height_m=true.height_m * np.exp(log_height),
            distortion=true.distortion,
            centre_uv=tuple(true.K[:2, 2]),
        )
        errors.append(error_without_scale(drawn, true, feet_uv))
    return float(np.sqrt(np.mean(np.square(errors))))


def error_without_scale(found: Camera, true: Camera, feet_uv: np.ndarray) -> float:
    """Rms correspondence error (m) after alignment with scale (Umeyama 1991), at true scale.

    Points are those within 100 m that both cameras see on the ground.
    """
    there, on_ground = true.locate(feet_uv)
    here, also = found.locate(feet_uv)
    near = on_ground & also & (np.hypot(*(there - true.centre_m[:2]).T) < 100)
    rows = np.flatnonzero(near)[spread_points(there[near])]
    centred = here[rows] - here[rows].mean(axis=0)
    target = there[rows] - there[rows].mean(axis=0)
    U, S, Vt = np.linalg.svd(centred.T @ target)
    S[-1] *= np.sign(np.linalg.det(U @ Vt))
    scale = S.sum() / (centred**2).sum()
    return correspondence_error(scale * here[rows], there[rows]).rms_m


# --- the tables ----------------------------------------------------------------------------------


def cell(case: Case, found: Calibration | None) -> str:
    if found is None:
        return ""
    if not found or found.camera is None:
        return "refused"
    error, predicted = case.score(found)
    return f"{error:.2f}" if predicted is None else f"{error:.2f} ({predicted:.2f})"


def parts(cases: list[Case]) -> str:
    """A line per case, a column per variant; last, mean ratios (geometric) to the first, over the
    cases whose true camera is known.
    """
    found = [[variant.solve(case) for variant in VARIANTS] for case in cases]
    rows = [["people", *(variant.name for variant in VARIANTS)], ["---"] * (len(VARIANTS) + 1)]
    for case, results in zip(cases, found, strict=True):
        rows.append([case.name, *(cell(case, result) for result in results)])
    errors = np.array(
        [
            [case.score(result)[0] if result else np.nan for result in results]
            for case, results in zip(cases, found, strict=True)
            if case.true_to_m is None
        ]
    )
    ratio = np.exp(np.nanmean(np.log(errors / errors[:, :1]), axis=0))
    rows.append(["**mean ratio to shipped**", *(f"**{x:.2f}**" for x in ratio)])
    return markdown(rows)


def points(cases: Iterable[tuple[str, Case, Case]]) -> str:
    """Keypoints against boxes of the same people, the lens given to both."""
    rows = [["people", "boxes", "keypoints"], ["---"] * 3]
    for name, boxes, keypoints in cases:
        rows.append([name, cell(boxes, boxes.solve()), cell(keypoints, keypoints.solve())])
    return markdown(rows)


class Subset(Source):
    """Some frames of a video, with its clock, as if that were all there is."""

    def __init__(self, video: Path, indices: np.ndarray) -> None:
        self._video, self._indices = video, indices
        with open_source(video) as whole:
            assert whole.timeline is not None
            self.name, self.image_size, self.fps = whole.name, whole.image_size, whole.fps
            times = whole.timeline.time_s[indices]
        self.timeline = Timeline(times - times[0], np.ones(len(indices), bool))

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        wanted = self._indices[self._wanted(indices)]
        with open_source(self._video) as whole:
            yield from whole.frames(wanted.tolist())

    @property
    def warnings(self) -> tuple[str, ...]:
        return ()


def frames(video: Path, reference: Reference, everything: Seen) -> str:
    """Error by the number of frames: evenly spread, from random starts."""
    rows = [
        [
            "frames",
            "draws",
            "refused",
            "median error",
            "worst",
            "median predicted",
            "error < 2 predicted",
        ],
        ["---"] * 7,
    ]
    rng = np.random.default_rng(0)
    with open_source(video) as source:
        total = source.frame_count
    assert total is not None
    for count in COUNTS:
        found = []
        for phase in rng.uniform(0, 1, DRAWS[count]):
            chosen = ((np.arange(count) + phase) * total / count).astype(int)
            case = of_footage("", seen_in(Subset(video, chosen)), reference)
            found.append((case, case.solve()))
        rows.append([str(count), str(DRAWS[count]), *spread_of(found)])
    whole = of_footage("", everything, reference)
    rows.append([f"all {total}", "1", *spread_of([(whole, whole.solve())])])
    return markdown(rows)


def spread_of(found: list[tuple[Case, Calibration]]) -> list[str]:
    good = [case.score(result) for case, result in found if result]
    refused = str(len(found) - len(good))
    if not good:
        return [refused, "", "", "", ""]
    error, predicted = np.array(good, float).T
    within = f"{np.mean(error < 2 * predicted):.0%}"
    return [
        refused,
        *(f"{x:.2f} m" for x in (np.median(error), error.max(), np.median(predicted))),
        within,
    ]


def markdown(rows: list[list[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)


def tables(data: Path) -> str:
    park, street = pets(data / "pets2009"), towncentre(data / "towncentre")
    video = data / "pets2009" / "vtest.avi"
    with open_source(video) as source:
        default = watch(source, CalibrateOptions(), Silent(), {})
    with open_source(video) as source:
        everything = seen_in(source)
    with open_source(data / "towncentre" / "frames") as source:
        pair = seen_in(source)
    boxes = [
        of_boxes(f"{name} boxes, lens", annotated(path, reference), reference)
        for name, path, reference in (
            ("PETS Faster R-CNN", data / "pets2009" / "frcnn_det.txt", park),
            ("PETS hand-drawn", data / "pets2009" / "PETS2009-S2L1.xml", park),
            ("TownCentre tracker", data / "towncentre" / "tracker_boxes.txt", street),
        )
    ]
    thirds = np.array_split(np.arange(THIRDS * (everything.frames // THIRDS)), THIRDS)
    keypoints = [
        of_footage("PETS video", default, park),
        *(
            of_footage(
                f"PETS video, third {number}", seen_in(Subset(video, third[::THIRD_STEP])), park
            )
            for number, third in enumerate(thirds, start=1)
        ),
        of_footage("TownCentre, 2 frames", pair, street),
    ]
    same_people = [
        (
            name,
            of_boxes("", seen.detections, reference),
            of_footage("", replace(seen, edges_xyxy=None), reference, reference.camera.lens),
        )
        for name, seen, reference in (
            ("PETS video", default, park),
            ("TownCentre, 2 frames", pair, street),
        )
    ]
    return "\n\n".join(
        [
            "## One part at a time",
            parts([*keypoints, *boxes, *(boxes_of_actors(name, data) for name in MEVA_CAMERAS)]),
            "## Keypoints against boxes",
            points(same_people),
            "## Number of frames (PETS video)",
            frames(video, park, everything),
        ]
    )


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into docs/ablation.md")
    arguments = parser.parse_args()
    text = tables(arguments.data)
    print(text)
    if arguments.write:
        before, rest = PAGE.read_text().split(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    main()
