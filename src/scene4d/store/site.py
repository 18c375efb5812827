"""Sites: several cameras on one ground and one clock, with one number for each person and vehicle.

    SITE/site.json                     where the cameras stand (:mod:`scene4d.store.site_file`)
    SITE/identities-VERSION.parquet    camera, track (as in its scene), identity, probability
    SITE/cameras/NAME-VERSION.json     calibrations refined over what several cameras saw

The tracks stay in the scenes; a site maps them while it reads.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.placement import Placement
from scene4d.core.text import in_file
from scene4d.core.tracks import Tracks
from scene4d.store._question import Question, check_range, check_there, checked_rectangle
from scene4d.store.fusing import fused
from scene4d.store.identities import Identities
from scene4d.store.query import Scene
from scene4d.store.regrounding import in_site, regrounded
from scene4d.store.runs import Run, moment
from scene4d.store.schema import with_keypoints
from scene4d.store.site_errors import SiteErrors
from scene4d.store.site_file import (
    SiteAnchor,
    SiteCamera,
    SiteFile,
)

STEP_S = 0.2
"""Time between rows of fused tracks: people and vehicles do little in less, and cameras of 5 frames
a second and more have a row for each."""
_NS = 1e9
_MOST_SHOWN = 4000
"""Positions in a notebook's plan."""


@dataclass(frozen=True)
class RunClock:
    """The time of a run's clip and that of its site: ``camera_s`` is what to add to the clip's for
    its camera's clock.
    """

    camera_s: float
    placement: Placement

    def in_site(self, clip_s: float) -> float:
        """A moment of the clip on the site's clock."""
        rate, at_s = self._drift
        return clip_s + self._shift_s + rate * (clip_s - at_s)

    def in_clip(self, site_s: float) -> float:
        """A moment of the site's clock in the clip."""
        rate, at_s = self._drift
        return (site_s - self._shift_s + rate * at_s) / (1 + rate)

    def middle_shift_s(self, span_s: tuple[float, float] | None) -> float:
        """What to add to times of the clip for the site's clock, in the middle of a span."""
        begin_s, end_s = span_s or (0.0, 0.0)
        rate, at_s = self._drift
        return self._shift_s + rate * ((begin_s + end_s) / 2 - at_s)

    @property
    def _shift_s(self) -> float:
        return self.placement.time_offset_s + self.camera_s

    @property
    def _drift(self) -> tuple[float, float]:
        """The rate, and the time of the clip at which the shift holds."""
        drift = self.placement.drift
        return (0.0, 0.0) if drift is None else (drift.rate, drift.at_s - self.camera_s)


class Site:
    """The cameras of a folder that ``align`` wrote, and their tracks on one ground and clock.

    :meth:`tracks` and :meth:`camera_tracks` take the fields of :class:`Question` as keywords, in
    the site's frame: ``begin`` and ``end`` are seconds of the site's clock or moments, ``within_m``
    is on its ground, ``tracks`` are identities. They load only the rows that are asked for, and
    raise :class:`InputError` as :class:`Scene` does.
    """

    def __init__(self, folder: Path, said: SiteFile) -> None:
        self.folder, self._said = folder, said

    @classmethod
    def open(cls, folder: "str | os.PathLike[str]") -> "Site":
        """Read a site; raises :class:`InputError` if there is none or its file is wrong."""
        return cls(Path(folder), SiteFile.load(Path(folder)))

    def to_dict(self) -> dict[str, Any]:
        """The content of ``site.json``."""
        return self._said.to_dict(self.folder)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras whose place is known, as they are called in the site."""
        return tuple(name for name, one in self._said.cameras.items() if one.placement)

    @property
    def placements(self) -> dict[str, Placement]:
        """Where each camera's ground and clock lie, also of those that are undetermined."""
        return {name: one.placement for name, one in self._said.cameras.items()}

    @property
    def anchor(self) -> SiteAnchor | None:
        """What the site's frame is tied to; None or false: to one of its cameras."""
        return self._said.anchor

    @property
    def errors(self) -> SiteErrors | None:
        """What the cameras err by together; None where ``site.json`` does not tell."""
        return self._said.errors

    @property
    def start(self) -> datetime | None:
        """The moment at which the site's clock is 0; None where no camera's clock is known."""
        return None if self._said.start_ns is None else moment(self._said.start_ns)

    def placed(self, camera: str) -> SiteCamera:
        """A camera's entry; raises :class:`InputError` for one that is not in the site."""
        check_there([camera], tuple(self._said.cameras), "camera")
        return self._said.cameras[camera]

    def scene(self, camera: str) -> Scene:
        """The scene of a camera: those of its runs that the site holds. Raises :class:`InputError`
        where it was tracked again: identities name the tracks of before.
        """
        one = self.placed(camera)
        if camera not in self._scenes:
            scene = _runs_of(Scene.open(one.scene), one)
            for run in scene.runs:
                held = one.tracked and one.tracked[run.run]
                if held and run.tracked(held.parts) != held:
                    raise InputError(
                        f"{self.folder}: camera {camera!r} was tracked again after the site was "
                        f"made (run {run.run!r} of {one.scene}); align again"
                    )
            self._scenes[camera] = scene
        return self._scenes[camera]

    def whole(self) -> tuple[Scene, dict[str, int]]:
        """One scene of all cameras, placed or not, and what it adds to the track numbers of each.

        Raises :class:`InputError` where two cameras have one name in their scenes.
        """
        offsets: dict[str, int] = {}
        total = 0
        for name in self._said.cameras:
            offsets[name] = total
            total += self.scene(name).numbers
        return Scene.open(*map(self.scene, offsets)), offsets

    def calibration(self, camera: str) -> Calibration:
        """The calibration whose ground is placed: refined, or that of the scene."""
        if camera not in self._calibrations:
            self._calibrations[camera] = Calibration.load(self.placed(camera).camera)
        return self._calibrations[camera]

    def camera(self, camera: str) -> Camera:
        """A camera in the site's frame; raises :class:`InputError` if its place is not known."""
        found = self.calibration(camera).camera
        assert found is not None
        return self.placed(camera).placement.camera(found)

    @cached_property
    def identities(self) -> Identities:
        """Which tracks are one and the same."""
        return Identities.load(self.folder / self._said.identities)

    @property
    def span_s(self) -> tuple[float, float]:
        """The first and last time of a row on the site's clock; raises :class:`InputError` where no
        camera has a place.
        """
        spans = [
            (clock.in_site(begin), clock.in_site(end))
            for camera in self._asked_cameras(None)
            for run, clock in self.runs(camera)
            if run.span_s
            for begin, end in [run.span_s]
        ]
        return min(begin for begin, _ in spans), max(end for _, end in spans)

    def runs(self, camera: str) -> list[tuple[Run, RunClock]]:
        """A camera's runs, each with its clock."""
        placement, start_ns = self.placed(camera).placement, self._said.start_ns
        return [
            (run, RunClock(clock_s(run, start_ns), placement)) for run in self.scene(camera).runs
        ]

    def tracks(self, *, step_s: float = STEP_S, **asked: Unpack[Question]) -> Tracks:
        """People and vehicles by identity, ordered by (track, time): what several cameras saw of
        one at a time is fused into one row (:func:`.fused`) with a smaller covariance.

        Rows lie at multiples of ``step_s`` of the site's clock. Boxes and keypoints belong to one
        camera and are left out. Without the cameras that have no place.
        """
        cameras = self._asked_cameras(asked.get("cameras"))
        seen = [self.camera_tracks(camera, keypoints=False, **asked) for camera in cameras]
        return self.fused(cameras, seen, step_s)

    def fused(self, cameras: Sequence[str], seen: Sequence[Tracks], step_s: float) -> Tracks:
        """:func:`.fused` of what cameras saw in the site's frame, with errors that they share."""
        if self.errors is None:
            return fused(seen, step_s)
        return fused(seen, step_s, [partial(self.error_modes, camera) for camera in cameras])

    def stretches(self, length_s: float, **asked: Unpack[Question]) -> Iterator[Tracks]:
        """:meth:`tracks` in pieces of so many seconds, one in memory at a time; none is empty."""
        first, last = self.span_s
        begin = length_s * np.floor(first / length_s)
        while begin <= last:
            found = self.tracks(**asked | {"begin": begin, "end": begin + length_s})
            begin += length_s
            if len(found):
                yield found

    def camera_tracks(
        self, camera: str, *, keypoints: bool = True, **asked: Unpack[Question]
    ) -> Tracks:
        """What one camera saw, in the site's frame and on its clock, ordered by (track, time).

        ``track`` is the identity. ``shared_covariance_m2`` also holds what the placement is not
        sure of, velocities and headings likewise. Boxes and keypoints are the camera's own. Raises
        :class:`InputError` if the camera's place is not known.
        """
        one = self.placed(camera)
        if not one.placement:
            raise InputError(
                f"{self.folder}: camera {camera!r} has no place in the site: {one.placement.reason}"
            )
        check_range(asked.get("begin"), asked.get("end"))
        own = _own_question(asked)
        known = self.identities.of(camera)
        if asked.get("tracks") is not None:
            known = known.select(np.isin(known.identity, np.asarray(asked["tracks"])))
            own["tracks"] = known.track
        found = []
        for run, clock in self.runs(camera):
            limits = {name: self._in_clip(asked.get(name), clock) for name in ("begin", "end")}
            scene = self.scene(camera).only(run.run)
            rows = scene.tracks(keypoints=keypoints, **own | limits)  # type: ignore[arg-type]
            found.append(replace(rows, time_s=rows.time_s + clock.camera_s))
        tracks = self._placed_tracks(camera, _joined(found))
        tracks = known.numbered(tracks)
        return _inside(tracks, asked.get("within_m"))

    def _placed_tracks(self, camera: str, tracks: Tracks) -> Tracks:
        before, after = self.scene_calibration(camera), self.calibration(camera)
        if before is not after and len(tracks):
            tracks = regrounded(tracks, before, after)
        placement, modes = self.placed(camera).placement, None
        if self.errors is not None and after.covariance is not None:
            velocity = np.nan_to_num(tracks.velocity_mps)
            modes = self.errors.modes_m(camera, placement, after, tracks.xy_m, velocity)
        return in_site(tracks, placement, modes)

    def error_modes(
        self, camera: str, xy_m: Float[np.ndarray, "n 2"]
    ) -> Float[np.ndarray, "n 2 r"]:
        """By how much (m) points of the site's ground, seen by this camera, are off per standard
        deviation of each of the site's independent errors; NaN where it sees no ground.

        ``M @ M.swapaxes(1, 2)`` are covariances of points; with ``M`` the modes of one camera's
        points less those of another's, it is that of the ways between them. Raises
        :class:`InputError` for a camera without a place, and where ``site.json`` does not tell.
        """
        one, errors = self.placed(camera), self.errors
        if not one.placement or errors is None:
            reason = one.placement.reason or "its site.json has no errors; align again"
            raise InputError(f"{self.folder}: errors of camera {camera!r} are not known: {reason}")
        own = one.placement.inverse().points(xy_m)
        return errors.modes_m(camera, one.placement, self.calibration(camera), own)

    def _in_clip(self, when: Any, clock: RunClock) -> float | None:
        """A moment, or seconds of the site's clock, in seconds of a clip."""
        if when is None:
            return None
        if isinstance(when, datetime):
            if self.start is None:
                raise InputError(
                    "begin, end: when the footage began is not known; ask in seconds of the site's "
                    "clock"
                )
            when = (when - self.start).total_seconds()
        return clock.in_clip(float(when))

    def scene_calibration(self, camera: str) -> Calibration:
        """The calibration on whose ground the scene's rows are, before the site refined it."""
        one = self.placed(camera)
        path = self.scene(camera).camera_file(one.name)
        try:
            is_refined = not path.samefile(one.camera)
        except OSError as error:
            raise InputError(
                f"{self.folder}: the calibration of camera {camera!r} cannot be read: "
                f"{error.strerror}; align again"
            ) from None
        return Calibration.load(path) if is_refined else self.calibration(camera)

    def _asked_cameras(self, wanted: Sequence[str] | None) -> tuple[str, ...]:
        if wanted is not None:
            check_there(wanted, self.cameras, "camera")
            return tuple(wanted)
        if not self.cameras:
            raise InputError(f"{self.folder}: no camera of the site has a place")
        return self.cameras

    @cached_property
    def _scenes(self) -> dict[str, Scene]:
        return {}

    @cached_property
    def _calibrations(self) -> dict[str, Calibration]:
        return {}

    def to_pandas(self, **asked: Unpack[Question]) -> Any:
        """:meth:`tracks` as a pandas ``DataFrame``; raises :class:`UnavailableError` without it."""
        return self.tracks(**asked).to_pandas()

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """All tracks, for any library that supports Arrow's C stream interface."""
        return self.tracks().__arrow_c_stream__(requested_schema)

    def _repr_html_(self) -> str:
        from scene4d.core.notebook import beside, plan_svg

        undetermined = [name for name, one in self.placements.items() if not one]
        said = {"Cameras": ", ".join(self.cameras)}
        said |= {"Without a place": ", ".join(undetermined)} if undetermined else {}
        seen = {name: len(np.unique(self._cameras_of(name))) for name in self.cameras}
        said["Seen"] = ", ".join(f"{count} by {name}" for name, count in seen.items())
        said["In all"] = str(len(np.unique(self.identities.identity)))
        return beside(said, plan_svg(path for name in self.cameras for path in self._paths(name)))

    def _cameras_of(self, camera: str) -> Int[np.ndarray, "n"]:
        rows = self.identities.camera == camera
        return self.identities.identity[rows]

    def _paths(self, camera: str) -> Iterator[tuple[str, Float[np.ndarray, "n 2"]]]:
        placement = self.placements[camera]
        for class_name, xy in (
            self.scene(camera).paths(self.placed(camera).name, _MOST_SHOWN).values()
        ):
            yield class_name, placement.points(xy)


def clock_s(run: Run, start_ns: int | None) -> float:
    """What to add to times of a run (s) for its camera's clock: that of the day from the site's
    start if both are known, else the clip's own.
    """
    if start_ns is None or not run.start_known:
        return 0.0
    return (run.start_ns - start_ns) / _NS


def _runs_of(scene: Scene, one: SiteCamera) -> Scene:
    """The runs of a scene that a site holds."""
    there = [run.run for run in scene.runs if run.camera == one.name]
    with in_file(one.scene):
        check_there(one.runs, there, "run")
    return scene.only(*one.runs)


def _joined(parts: Sequence[Tracks]) -> Tracks:
    """One table; runs may differ in their keypoints."""
    most = max(part.keypoint_uv.shape[1] for part in parts)
    return Tracks.concatenate([with_keypoints(part, most) for part in parts])


def _own_question(asked: Question) -> Question:
    """What every run can be asked alike."""
    names = [name for name in ("classes", "observed") if asked.get(name) is not None]
    return {name: asked[name] for name in names}  # type: ignore[literal-required, return-value]


def _inside(tracks: Tracks, within_m: Any) -> Tracks:
    if within_m is None:
        return tracks
    x0, y0, x1, y1 = checked_rectangle(within_m)
    x, y = tracks.xy_m.T
    return tracks.select((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))
