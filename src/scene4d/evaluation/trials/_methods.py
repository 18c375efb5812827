"""Which methods are tried on which input, and what each of them is given."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from scene4d.calibration import person_segments
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen, solved
from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.orientation import Orientation
from scene4d.evaluation.datasets._reference import Reference
from scene4d.evaluation.trials.outcomes import PAPER_HEIGHTS_M, Outcome, Setting

HEIGHTS_M = tuple(sorted({*PAPER_HEIGHTS_M, PERSON_HEIGHT_M}))
"""Mean heights of people at which everything is tried: the paper's, and our default."""
_SHORT_FOCAL = (0.85, 0.70)
"""Focal length over the truth, to span the short focal lengths that the paper
reports of its network. Chosen by hand."""


@dataclass(frozen=True, eq=False)
class Input:
    """One kind of footage or boxes. ``circular``: generated from the true calibration itself."""

    footage: str
    seen: Seen
    circular: bool = False


@dataclass(frozen=True, eq=False)
class Trial:
    """One line of the table: an input, a method, and what it is given."""

    setting: Setting
    seen: Seen
    has_lens: bool = False
    orientation: Orientation | str | None = None

    def outcome(self, reference: Reference, person_height_m: float) -> Outcome:
        """Calibrate and score; a refusal is an outcome too. Without an orientation the orientation
        network is not used either.
        """
        options = CalibrateOptions(
            lens=reference.camera.lens if self.has_lens else None,
            person_height_m=person_height_m,
            method=self.setting.method,
            orientation=self.orientation or "people",
            # A focal length that is given counts instead of the lens's own.
            estimate_focal=isinstance(self.orientation, Orientation),
        )
        return Outcome.scored(self.setting, solved(self.seen, options), reference)


def trials(given: Input, truth: Orientation | None) -> Iterator[Trial]:
    """Everything that is tried on an input; ``truth`` is None where no true camera is known.

    The paper's method takes the mode of the orientation network's readings as exact; for the joint
    one they are a prior, as in ``scene4d calibrate``.
    """
    network = given.seen.reading is not None
    keypoints = not person_segments(given.seen.detections).from_box.all()
    boxes = replace(
        given.seen, detections=given.seen.detections.without_keypoints(), edges_xyxy=None
    )
    of_boxes = f"{given.footage}, boxes" if keypoints else given.footage

    def trial(
        footage: str,
        method: str,
        told: str,
        seen: Seen,
        *,
        has_lens: bool = False,
        orientation: Orientation | str | None = None,
        headline: bool = False,
    ) -> Trial:
        setting = Setting(footage, method, told, given.circular, headline)
        return Trial(setting, seen, has_lens, orientation)

    if truth is not None:
        told = "true f, tilt, roll"
        yield trial(of_boxes, "paper", told, boxes, has_lens=True, orientation=truth, headline=True)
        for share in _SHORT_FOCAL:
            wide = replace(truth, focal_px=share * truth.focal_px)
            told = f"{share:.2f} f, tilt, roll"
            yield trial(of_boxes, "paper", told, boxes, has_lens=True, orientation=wide)
    if network:
        yield trial(of_boxes, "paper", "network", boxes, orientation="network")
    yield trial(of_boxes, "joint", "nothing", boxes)
    if network:
        yield trial(of_boxes, "joint", "network", boxes, orientation="auto")
    if truth is not None:
        yield trial(of_boxes, "joint", "lens", boxes, has_lens=True)
    if not keypoints:
        return
    name = f"{given.footage}, keypoints"
    alone = replace(given.seen, edges_xyxy=None)
    yield trial(name, "joint", "nothing", given.seen, headline=True)
    yield trial(name, "joint", "nothing, no edges", alone)
    if truth is not None:
        yield trial(name, "joint", "lens", given.seen, has_lens=True)
    if network:
        yield trial(name, "joint", "network", given.seen, orientation="auto")
