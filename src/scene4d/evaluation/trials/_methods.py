"""Which methods are tried on which input, and what each of them is given."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from scene4d.calibration import person_segments
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.orienting import OrientationReading
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
    """One kind of footage or boxes. ``circular``: generated from the true calibration itself.

    ``straightened`` is what the network reads once the true lens is taken out of the pictures, its
    focal length unknown; None where there are no pictures, or no true lens.
    """

    footage: str
    seen: Seen
    circular: bool = False
    straightened: OrientationReading | None = None


@dataclass(frozen=True, eq=False)
class Trial:
    """One line of the table: an input, a method, and what it is given. Of a lens that it has,
    ``only_distortion`` may be believed.
    """

    setting: Setting
    seen: Seen
    has_lens: bool = False
    only_distortion: bool = False
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
            estimate_focal=isinstance(self.orientation, Orientation) or self.only_distortion,
        )
        return Outcome.scored(self.setting, solved(self.seen, options), reference)


def trials(given: Input, truth: Orientation | None) -> Iterator[Trial]:
    """Everything that is tried on an input; ``truth`` is None where no true camera is known.

    The paper's method takes the mode of the orientation network's readings as exact; for the joint
    one they are a prior, as in ``scene4d calibrate``. Where a line is given the lens, the network
    reads pictures that are free of its distortion.
    """
    keypoints = not person_segments(given.seen.detections).from_box.all()
    boxes = replace(given.seen, detections=given.seen.detections.without_keypoints())
    of_boxes = f"{given.footage}, boxes" if keypoints else given.footage
    boxed = replace(given, seen=boxes)
    yield from _paper_trials(of_boxes, boxed, truth)
    yield from _joint_trials(of_boxes, boxed, has_truth=truth is not None)
    if keypoints:
        name = f"{given.footage}, keypoints"
        yield from _joint_trials(name, given, has_truth=truth is not None, headline=True)
        alone = replace(given.seen, edges_xyxy=None)
        yield Trial(Setting(name, "joint", "nothing, no edges", given.circular), alone)


def _paper_trials(footage: str, given: Input, truth: Orientation | None) -> Iterator[Trial]:
    """The paper's method on boxes: given the true orientation, shorter focal lengths, and the
    network's reading of the pictures as they are (the headline, where there are pictures) and, as
    published, of undistorted ones.
    """

    def setting(told: str, *, headline: bool = False) -> Setting:
        return Setting(footage, "paper", told, given.circular, headline)

    seen = given.seen
    if truth is not None:
        told = setting("true f, tilt, roll")
        yield Trial(told, seen, has_lens=True, orientation=truth)
        for share in _SHORT_FOCAL:
            wide = replace(truth, focal_px=share * truth.focal_px)
            told = setting(f"{share:.2f} f, tilt, roll")
            yield Trial(told, seen, has_lens=True, orientation=wide)
    if seen.reading is not None:
        yield Trial(setting("network", headline=True), seen, orientation="network")
    if given.straightened is not None:
        yield Trial(
            setting("distortion, network"),
            replace(seen, reading=given.straightened),
            has_lens=True,
            only_distortion=True,
            orientation="network",
        )


def _joint_trials(
    footage: str, given: Input, *, has_truth: bool, headline: bool = False
) -> Iterator[Trial]:
    """The joint method; the line that is given nothing may be a headline."""

    def setting(told: str, *, headline: bool = False) -> Setting:
        return Setting(footage, "joint", told, given.circular, headline)

    seen = given.seen
    yield Trial(setting("nothing", headline=headline), seen)
    if seen.reading is not None:
        yield Trial(setting("network"), seen, orientation="auto")
    if has_truth:
        yield Trial(setting("lens"), seen, has_lens=True)
    if given.straightened is not None:
        known = replace(seen, reading=given.straightened.given_focal())
        yield Trial(setting("lens, network"), known, has_lens=True, orientation="auto")
