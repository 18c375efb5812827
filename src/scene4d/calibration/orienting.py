"""Reading a camera's orientation from its pictures alone, with nobody in them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int, UInt8

from scene4d.calibration.options import lens_for
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.progress import Progress, Silent

if TYPE_CHECKING:
    from scene4d.perception.orientation import Belief
    from scene4d.video.frames import Frame, Source

MOST_FRAMES = 1000
"""As many as the paper looks at."""
_FIRST_FRAMES = 4
"""Frames of the first round; every further round looks at as many as all before it."""
_SETTLED = 0.1
"""A round that moves no value by more than this share of its standard deviation changes nothing."""
_QUIET_ROUNDS = 2
"""After so many of them in a row no more frames are looked at."""
_VAGUE = 0.5
"""An interval wider than this share of an ignorant one tells nothing worth a number."""
NAMES = ("roll_deg", "tilt_deg", "vfov_deg")
"""What a belief is about, in the order of its axes."""


@dataclass(frozen=True, eq=False)
class OrientationReading:
    """What the orientation network reads in pictures of one camera.

    ``by_frame`` are the frames' numbers with what each says by itself, ``belief`` is what they say
    together; both are about the largest centred 4:3 part (:func:`.crop_size`). ``lens`` was taken
    out of the pictures first; ``focal_known`` says that its focal length was believed too.
    ``image_bgr`` (h, w, 3) is one of the pictures as the network saw it. The optical axis is
    assumed to meet the picture's centre.
    """

    belief: "Belief"
    by_frame: "tuple[tuple[int, Belief], ...]"
    image_size: tuple[int, int]
    lens: Lens | None = None
    focal_known: bool = False
    image_bgr: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """How many pictures were looked at."""
        return len(self.by_frame)

    @cached_property
    def orientation(self) -> Orientation:
        """Focal length, tilt and roll as a Gaussian, for pictures of this size."""
        return self._given_lens(self.belief.orientation(self.image_size))

    @cached_property
    def most_frequent(self) -> Orientation:
        """The mode over the frames, as the paper takes it, with the spreads of all together."""
        from scene4d.perception.orientation import modal

        roll, tilt, vfov = modal([belief for _, belief in self.by_frame])
        focal = self._focal_px(float(vfov))
        relative = self.orientation.spread[0]
        mode = replace(
            self.orientation,
            focal_px=focal,
            tilt_rad=float(tilt),
            roll_rad=float(roll),
            focal_sigma_px=focal * relative,
        )
        return self._given_lens(mode)

    def of_frame(self, index: int) -> "OrientationReading | None":
        """What one frame says by itself; None where the network did not look at it."""
        for number, belief in self.by_frame:
            if number == index:
                return replace(self, belief=belief, by_frame=((number, belief),))
        return None

    def given_focal(self) -> "OrientationReading":
        """The same reading, with the focal length of the lens believed as well."""
        from scene4d.perception.orientation import fused

        assert self.lens is not None
        by_frame = tuple(
            (number, _given_focal(belief, self.lens, self.image_size))
            for number, belief in self.by_frame
        )
        together = fused([belief for _, belief in by_frame])
        return replace(self, belief=together, by_frame=by_frame, focal_known=True)

    @cached_property
    def camera(self) -> Camera:
        """A camera of this orientation, one metre above the ground: its height is not read."""
        told = self.orientation
        posed = Camera.from_pose(
            image_size=self.image_size,
            focal_px=told.focal_px,
            tilt_rad=told.tilt_rad,
            roll_rad=told.roll_rad,
            height_m=1.0,
        )
        if self.lens is None:
            return posed
        stretch = 1.0 if self.focal_known else told.focal_px / float(self.lens.K[1, 1])
        return self.lens.refocused(stretch).posed(posed.R, posed.t)

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Central 95 % intervals, in the units and with the names of :meth:`to_dict`."""
        roll, tilt, crop = (self.belief.interval(axis) for axis in range(3))
        focal = (self._focal_px(crop[1]), self._focal_px(crop[0]))
        if self.focal_known:
            focal = (self.orientation.focal_px, self.orientation.focal_px)
        vfov = (self._vfov_deg(focal[1]), self._vfov_deg(focal[0]))
        angles = {
            name: (float(np.degrees(low)), float(np.degrees(high)))
            for name, (low, high) in (("tilt_deg", tilt), ("roll_deg", roll))
        }
        return {"focal_px": focal, **angles, "vfov_deg": vfov}

    @cached_property
    def vague(self) -> tuple[str, ...]:
        """Which of :data:`NAMES` the pictures do not tell: see :data:`_VAGUE`."""
        from scene4d.perception.orientation import Belief

        ignorant = Belief.even()
        return tuple(
            name
            for axis, name in enumerate(NAMES)
            if _width(self.belief, axis) > _VAGUE * _width(ignorant, axis)
        )

    def to_dict(self) -> dict[str, Any]:
        """The object that ``scene4d orientation --json`` prints, read by :meth:`Orientation.load`.

        ``vfov_deg`` is the angle of the whole picture's height.
        """
        told = self.orientation
        vfov = self._vfov_deg(told.focal_px)
        return {
            "focal_px": told.focal_px,
            "tilt_deg": float(np.degrees(told.tilt_rad)),
            "roll_deg": float(np.degrees(told.roll_rad)),
            "vfov_deg": vfov,
            "sigma": {
                "focal_px": told.focal_sigma_px,
                "tilt_deg": float(np.degrees(told.tilt_sigma_rad)),
                "roll_deg": float(np.degrees(told.roll_sigma_rad)),
                # d vfov / d log f of vfov = 2 atan(h / 2 f)
                "vfov_deg": float(np.degrees(np.sin(np.radians(vfov)) * told.spread[0])),
            },
            "frames": self.frames,
        }

    def _given_lens(self, told: Orientation) -> Orientation:
        """As told of the picture's middle; of the optical axis where the lens says where it is."""
        if self.lens is None:
            return told
        if self.focal_known:
            told = replace(told, focal_px=float(self.lens.K[0, 0]), focal_sigma_px=0.0)
        right, down = self.lens.K[:2, 2] - (np.array(self.image_size) - 1) / 2
        below = down * np.cos(told.roll_rad) - right * np.sin(told.roll_rad)
        return replace(told, tilt_rad=told.tilt_rad + float(np.arctan2(below, told.focal_px)))

    def _focal_px(self, crop_vfov_rad: float) -> float:
        from scene4d.perception.orientation import crop_size

        return float(crop_size(self.image_size)[1] / 2 / np.tan(crop_vfov_rad / 2))

    def _vfov_deg(self, focal_px: float) -> float:
        return float(np.degrees(2 * np.arctan(self.image_size[1] / 2 / focal_px)))


def _width(belief: "Belief", axis: int) -> float:
    """Of the 95 % interval; a field of view counts by its logarithm."""
    low, high = belief.interval(axis)
    return float(np.log(high / low)) if NAMES[axis] == "vfov_deg" else high - low


class OrientationReader:
    """Shows frames of one camera to the network, and tells what they say together.

    A ``lens`` for pictures of this size is taken out of them first; ``focal_known`` also believes
    its focal length (its principal point is not used). Of the frames offered every ``step``-th is
    looked at. A frame takes 0.4 MB; no picture is kept but the first.
    """

    def __init__(
        self,
        image_size: tuple[int, int],
        lens: Lens | None = None,
        *,
        focal_known: bool = True,
        step: int = 1,
    ) -> None:
        from scene4d.perception.orientation import PoseReader
        from scene4d.video.undistort import Undistorter

        self._network = PoseReader(still=True)
        self._straighten = None if lens is None else Undistorter(lens)
        self._lens = lens
        self._size, self._step, self._offered = image_size, step, 0
        self._focal_known = lens is not None and focal_known
        self._by_frame: list[tuple[int, Belief]] = []
        self._image: np.ndarray | None = None

    @property
    def frames(self) -> int:
        """How many frames were looked at."""
        return len(self._by_frame)

    def offer(self, frame: "Frame") -> None:
        """One frame. Raises :class:`InputError` where it is too small to read anything in."""
        if self._offered % self._step == 0:
            self.look(frame.index, frame.image_bgr)
        self._offered += 1

    def look(self, index: int, image_bgr: np.ndarray) -> None:
        """As :meth:`offer`, a picture that is certainly looked at."""
        image = image_bgr if self._straighten is None else self._straighten(image_bgr)
        belief = self._network.belief(image)
        if self._lens is not None and self._focal_known:
            belief = _given_focal(belief, self._lens, self._size)
        self._by_frame.append((index, belief))
        if self._image is None:
            self._image = image.copy()

    def belief(self) -> "Belief":
        """What all frames so far say together."""
        from scene4d.perception.orientation import fused

        return fused([belief for _, belief in self._by_frame])

    def reading(self, notes: tuple[str, ...] = ()) -> OrientationReading:
        """Everything that was read. Raises :class:`InputError` where there was no frame."""
        if not self._by_frame:
            raise InputError("orientation: there was no picture to read it in")
        return OrientationReading(
            belief=self.belief(),
            by_frame=tuple(self._by_frame),
            image_size=self._size,
            lens=self._lens,
            focal_known=self._focal_known,
            image_bgr=self._image,
            notes=notes,
        )


def _given_focal(belief: "Belief", lens: Lens, image_size: tuple[int, int]) -> "Belief":
    """What a belief about pictures of this size becomes once the lens's focal length is known."""
    from scene4d.perception.orientation import crop_size

    half = crop_size(image_size)[1] / 2
    return belief.given_vfov(float(2 * np.arctan(half / lens.K[1, 1])))


def read_orientation(
    source: str | Path,
    *,
    lens: str | Path | Lens | None = None,
    focal_known: bool = True,
    frames: int | None = None,
    progress: Progress | None = None,
) -> OrientationReading:
    """Focal length, tilt and roll of a fixed camera from its pictures alone.

    ``source`` as in :func:`.calibrate`. ``lens`` (a camera file, or a lens for pictures of this
    size) is taken out of the pictures, and its focal length believed unless ``focal_known`` is
    false; the optical axis is assumed to meet the picture's centre whatever it says. ``frames`` up
    to :data:`MOST_FRAMES` spread evenly over the footage are looked at; without it, as many as
    change the answer. A camera that moves is noted, not refused. Raises :class:`InputError` for
    footage that cannot be read or is too small, for a lens that does not fit it, and for frames
    out of range.
    """
    from scene4d.video.motion import MotionMonitor
    from scene4d.video.reader import open_source

    if frames is not None and not 1 <= frames <= MOST_FRAMES:
        raise InputError(f"frames must lie in 1 to {MOST_FRAMES}, found {frames}")
    progress = progress or Silent()
    with open_source(source) as footage:
        known = lens_for(lens, footage.image_size)
        reader = OrientationReader(footage.image_size, known, focal_known=focal_known)
        monitor = MotionMonitor(footage.image_size)
        before, quiet = None, 0
        with progress.stage("Reading the orientation", frames) as step:
            for batch in _rounds(footage, frames):
                looked_at = reader.frames
                for frame in batch:
                    reader.offer(frame)
                    monitor.add(frame.image_bgr, frame.time_s)
                    step(1)
                if reader.frames == looked_at:
                    break
                now = reader.belief()
                moves = before is None or not settled(before, now, footage.image_size)
                before, quiet = now, 0 if moves else quiet + 1
                if quiet == _QUIET_ROUNDS:
                    break
        if not reader.frames:
            raise InputError(f"{footage.name}: no frame could be read")
        verdict = monitor.verdict()
        moved = (f"The reading mixes several views: {verdict.reason}.",) if verdict.moved else ()
        return reader.reading((*moved, *footage.warnings))


def read_straightened(image_bgr: UInt8[np.ndarray, "h w 3"], lens: Lens) -> OrientationReading:
    """What one picture says of its middle once the distortion of ``lens`` is taken out of it.

    Neither the lens's focal length nor its principal point is believed.
    """
    height, width = image_bgr.shape[:2]
    reader = OrientationReader((width, height), lens, focal_known=False)
    reader.look(0, image_bgr)
    return replace(reader.reading(), lens=None)


def settled(before: "Belief", now: "Belief", image_size: tuple[int, int]) -> bool:
    """Whether no value has moved by more than :data:`_SETTLED` of its standard deviation."""
    (old, _), (new, sigma) = (_values(belief, image_size) for belief in (before, now))
    return bool(np.all(np.abs(new - old) <= _SETTLED * sigma))


def _values(belief: "Belief", image_size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    told = belief.orientation(image_size)
    return np.array([np.log(told.focal_px), told.tilt_rad, told.roll_rad]), np.array(told.spread)


def _rounds(footage: "Source", frames: int | None) -> "Iterator[Iterator[Frame]]":
    """The wanted number of frames at once; without a wish, rounds that double what was seen.

    Each round lies between the frames of those before it; of a stream it is what comes next.
    """
    from scene4d.video.sampling import choose_frames, sample_frames

    if frames is not None:
        yield sample_frames(footage, frames)
        return
    seen = 0
    if footage.timeline is None:
        stream = sample_frames(footage, MOST_FRAMES)
        while seen < MOST_FRAMES:
            count = max(seen, _FIRST_FRAMES)
            yield islice(stream, count)
            seen += count
        return
    chosen = choose_frames(footage.timeline, MOST_FRAMES, footage.image_size)
    chosen = chosen[halving_order(len(chosen))]
    while seen < len(chosen):
        count = max(seen, _FIRST_FRAMES)
        yield footage.frames(sorted(chosen[seen : seen + count].tolist()))
        seen += count


def halving_order(n: int) -> Int[np.ndarray, "n"]:
    """The numbers below ``n >= 1`` so that each next one lies in the widest gap: bits reversed."""
    bits = max(1, (n - 1).bit_length())
    order = np.arange(2**bits)
    backwards = sum(((order >> bit) & 1) << (bits - 1 - bit) for bit in range(bits))
    return np.asarray(backwards)[np.asarray(backwards) < n]
