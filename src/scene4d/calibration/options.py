"""The options of a calibration: one object from the command line to the solver."""

from dataclasses import dataclass, replace
from pathlib import Path

from scene4d.core.body import FOOT_HEIGHT_M, PERSON_HEIGHT_M
from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.core.landmarks import Landmarks
from scene4d.core.orientation import Orientation
from scene4d.core.text import in_file

METHODS = ("joint", "paper")
CONSENSUS = ("exact", "ransac")
VEHICLES = ("auto", "always", "never")
_POPULATION_SIGMA_M = 0.03
"""Standard deviation of the mean height of the people in a scene. Chosen: national means of adults
of both sexes differ by about this much (METHOD section 4)."""
_WORDS = ("auto", "people", "network")


@dataclass(frozen=True)
class CalibrateOptions:
    """How to calibrate, and the known values.

    Input: ``frames`` is how many to use (default: one per second, 100 to 200). ``annotations`` is a
    file of boxes or keypoints to use instead of the detector, in the given ``format`` or the one
    that the file shows; with ``drop_invalid``, impossible boxes are skipped instead of refusing the
    file. ``image_size`` is needed if there is no footage.

    ``device`` says where the networks of people and vehicles run, as in :class:`TrackOptions`.

    Known values: ``person_height_m`` is the mean height of the people, shoes included, and
    ``population_sigma_m`` its standard deviation. ``lens`` (a camera file, or a :class:`Lens`)
    fixes intrinsics and distortion; with ``estimate_focal`` only the distortion. ``orientation`` is
    ``"auto"`` (the orientation network's estimate is a guess that the people can overrule),
    ``"people"`` (no network), ``"network"`` (the network's estimate is used as is), a JSON file or
    an :class:`Orientation`. ``landmarks`` (a JSON or CSV file, or :class:`Landmarks`) are ground
    points, heights and distances that somebody has measured. The paper's method uses the network's
    estimate for ``"auto"`` too.

    Solver: ``method`` ``"joint"`` estimates everything together; ``"paper"`` takes focal length,
    tilt and roll from the orientation and solves for the height alone, from boxes even where
    keypoints are known (Wagner et al. 2019), by the ``consensus`` ``"exact"`` or, as published,
    ``"ransac"``. ``lines`` uses the straight edges of the scene, ``estimate_distortion`` estimates
    a radial coefficient if no lens is given.
    ``vehicles`` says when moving vehicles serve as rulers besides people: ``"auto"`` where people
    alone do not determine the camera, ``"always"`` or ``"never"``.
    ``foot_height_m`` is the height of the foot points (0 for boxes) above the ground.
    ``systematics`` adds the errors that all people of real footage share and treats the places of
    one track as correlated. ``seed`` is the seed of all sampling.

    Raises :class:`InputError` for values out of range, naming the field.
    """

    lens: str | Path | Lens | None = None
    annotations: str | Path | None = None
    image_size: tuple[int, int] | None = None
    person_height_m: float = PERSON_HEIGHT_M
    method: str = "joint"
    orientation: str | Path | Orientation = "auto"
    landmarks: str | Path | Landmarks | None = None
    estimate_focal: bool = False
    frames: int | None = None
    device: str = "auto"
    seed: int = 0
    drop_invalid: bool = False
    format: str | None = None
    lines: bool = True
    vehicles: str = "auto"
    consensus: str = "exact"
    foot_height_m: float = FOOT_HEIGHT_M
    population_sigma_m: float = _POPULATION_SIGMA_M
    estimate_distortion: bool = True
    systematics: bool = True

    def __post_init__(self) -> None:
        for name, allowed in (
            ("method", METHODS),
            ("consensus", CONSENSUS),
            ("vehicles", VEHICLES),
        ):
            if getattr(self, name) not in allowed:
                raise InputError(f"{name} must be one of {allowed}, found {getattr(self, name)!r}")
        height_m = self.person_height_m
        if not 0.5 <= height_m <= 2.5:
            raise InputError(f"person_height_m must lie in 0.5 to 2.5 metres, found {height_m}")
        if not 0 <= self.population_sigma_m < height_m:
            raise InputError(
                f"population_sigma_m must be 0 or more, found {self.population_sigma_m}"
            )
        if not 0 <= self.foot_height_m < height_m / 2:
            raise InputError(
                f"foot_height_m must lie in 0 to half a person, found {self.foot_height_m}"
            )
        if self.method == "paper" and self.orientation == "people":
            raise InputError(
                "the paper's method needs the camera's orientation (focal length, tilt, roll): "
                'pass orientation="network" or an orientation file, or use method "joint"'
            )
        if self.method == "paper" and self.landmarks is not None:
            raise InputError(
                "the paper's method estimates the height from people alone and cannot use "
                'landmarks; use method "joint"'
            )
        if self.frames is not None and self.frames < 1:
            raise InputError(f"frames must be at least 1, found {self.frames}")
        if self.image_size is not None and min(self.image_size) < 1:
            raise InputError(f"image_size must be positive, found {self.image_size}")

    @property
    def uses_network(self) -> bool:
        """Whether the orientation network is used."""
        return self.orientation in ("auto", "network")

    @property
    def needs_network(self) -> bool:
        """Whether there is no result without it: the paper's method needs an orientation."""
        return self.orientation == "network" or (self.uses_network and self.method == "paper")

    @property
    def known_lens(self) -> Lens | None:
        """The lens, once its file has been read (:meth:`read`)."""
        assert not isinstance(self.lens, str | Path)
        return self.lens

    @property
    def known_landmarks(self) -> Landmarks | None:
        """The landmarks, once their file has been read (:meth:`read`)."""
        assert not isinstance(self.landmarks, str | Path)
        return self.landmarks

    @property
    def known_orientation(self) -> Orientation | None:
        """The user's orientation, once its file has been read (:meth:`read`)."""
        return self.orientation if isinstance(self.orientation, Orientation) else None

    @property
    def fixed_focal_px(self) -> float | None:
        """The focal length of the lens, if it is used; it outranks an orientation's."""
        lens = self.known_lens
        return None if lens is None or self.estimate_focal else float(lens.K[0, 0])

    def read(self, image_size: tuple[int, int]) -> "CalibrateOptions":
        """A copy with ``lens``, ``orientation`` and ``landmarks`` read from their files, for this
        image size.
        """
        lens, orientation, landmarks = self.lens, self.orientation, self.landmarks
        lens = lens_for(lens, image_size)
        if lens is not None and lens.is_fisheye and self.estimate_focal:
            raise InputError(
                "estimate_focal: which way a pixel of a fisheye lens looks depends on its focal "
                "length, so that its distortion alone cannot be used; pass the lens without "
                "estimate_focal, or no lens"
            )
        if not isinstance(orientation, Orientation) and orientation not in _WORDS:
            orientation = Orientation.load(orientation)
        if landmarks is not None:
            landmarks = _landmarks(landmarks, image_size)
        return replace(self, lens=lens, orientation=orientation, landmarks=landmarks)


def lens_for(given: str | Path | Lens | None, image_size: tuple[int, int]) -> Lens | None:
    """The lens that is given, or that its file holds, for pictures of this size."""
    if given is None or isinstance(given, Lens):
        return given and given.scaled_to(image_size)
    from scene4d.formats.cameras import read_lens

    return read_lens(given, image_size=image_size)


def _landmarks(given: str | Path | Landmarks, image_size: tuple[int, int]) -> Landmarks:
    if isinstance(given, Landmarks):
        return given.inside(image_size)
    with in_file(given):
        return Landmarks.load(given).inside(image_size)


POINTS = CalibrateOptions(
    orientation="people", population_sigma_m=0.0, estimate_distortion=False, systematics=False
)
"""For bare points: no prior and no systematic errors; uncertainties are conditional on that."""
