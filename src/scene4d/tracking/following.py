"""From placed sightings to smooth tracks, in a stream."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.progress import timed
from scene4d.core.tracks import VEHICLES, Located, Tracks
from scene4d.tracking.association import GroundTracker
from scene4d.tracking.counting import FORGET_S
from scene4d.tracking.fixed_lag import FixedLagSmoother
from scene4d.tracking.options import TrackRun
from scene4d.tracking.placing import bottoms_hidden, place, shared_covariance
from scene4d.tracking.sightings import Sightings
from scene4d.tracking.smoothing import Smoothed, SmoothingSettings, smooth
from scene4d.tracking.vehicles import locate_vehicles


@dataclass(frozen=True, eq=False)
class Look:
    """What was seen in some successive frames (m,), all of those that were looked at.

    ``appearance`` (n, d) belongs to the rows of ``detections``, or is None.
    """

    frame: Int[np.ndarray, "m"]
    time_s: Float[np.ndarray, "m"]
    detections: Detections
    appearance: np.ndarray | None = None

    def frames(self) -> Iterator[tuple[int, float, Int[np.ndarray, "k"]]]:
        """Number and time of each frame, and which rows are of it: they are ordered by frame."""
        begins = np.searchsorted(self.detections.frame, self.frame)
        ends = np.searchsorted(self.detections.frame, self.frame, side="right")
        for frame, time_s, begin, end in zip(self.frame, self.time_s, begins, ends, strict=True):
            yield int(frame), float(time_s), np.arange(begin, end)


class Follower:
    """Takes looks in order of time, and gives the tracks that have become final.

    Detections that have tracks keep them. Memory does not grow with the length of the footage.
    """

    def __init__(
        self,
        calibration: Calibration,
        person_height_m: float,
        run: TrackRun,
        *,
        min_sightings: int = 1,
    ) -> None:
        assert calibration.camera is not None
        self._calibration = calibration
        self._camera: Camera = calibration.camera
        self._person_height_m = person_height_m
        self._settings = settings = SmoothingSettings(min_sightings=min_sightings)
        self._run = run
        self._tracker = GroundTracker()
        self._smoother = FixedLagSmoother(settings)
        self._held: list[tuple[int, Detections, Located]] = []  # with the number of the first row
        self._rows = 0
        self._headings: dict[int, tuple[float, float]] = {}  # last heading in motion, and when

    def follow(self, look: Look) -> Iterator[Tracks]:
        """Add some frames."""
        timings = self._run.timings
        with timed(timings, "place"):
            hidden = bottoms_hidden(look.detections)
            located = place(look.detections, self._camera, self._person_height_m, hidden)
        with timed(timings, "associate"):
            track = self._associate(look, located)
        with timed(timings, "place"):
            located = self._with_headings(look, located, track, hidden)
        self._run.without_position += int((~located.known).sum())
        seen = Sightings(
            track,
            look.detections.class_name,
            look.detections.time_s,
            look.detections.frame,
            located.xy_m,
            located.covariance_m2,
        )
        self._held.append((self._rows, look.detections, located))
        self._rows += len(track)
        for frame, time_s, rows in look.frames():
            with timed(timings, "smooth"):
                final = self._smoother.update(time_s, frame, seen.select(rows))
            if final is not None:
                yield self._tracks(final)
                self._forget(time_s - self._settings.lag_s)

    def finish(self) -> Tracks:
        """All that is left."""
        with timed(self._run.timings, "smooth"):
            final = self._smoother.finish()
        return self._tracks(final)

    def _associate(self, look: Look, located: Located) -> Int[np.ndarray, "n"]:
        """Track numbers of all rows: those they have, else those of the tracker."""
        detections = look.detections
        if (detections.track >= 0).all():
            return detections.track
        track = np.empty(len(detections), np.int64)
        for _, time_s, rows in look.frames():
            track[rows] = self._tracker.update(
                time_s,
                detections.select(rows),
                located.select(rows),
                None if look.appearance is None else look.appearance[rows].astype(float),
            )
        return track

    def _with_headings(
        self,
        look: Look,
        located: Located,
        track: Int[np.ndarray, "n"],
        hidden: Bool[np.ndarray, "n"],
    ) -> Located:
        """Vehicles placed again with the heading of their motion, where they move."""
        d = look.detections
        moving = np.isin(d.class_name, VEHICLES) & located.known
        if not moving.any():
            return located
        rows = np.flatnonzero(moving)
        rough = smooth(
            Sightings(
                track[rows],
                d.class_name[rows],
                d.time_s[rows],
                d.frame[rows],
                located.xy_m[rows],
                located.covariance_m2[rows],
            ),
            settings=self._settings,
        )
        heading, sigma = np.full((2, len(d)), np.nan)
        heading[rows[rough.source]] = rough.heading_rad
        sigma[rows[rough.source]] = rough.heading_sigma_rad
        known = np.isfinite(heading)
        if not known.any():
            return located
        again = locate_vehicles(
            d.select(known),
            self._camera,
            heading_rad=heading[known],
            heading_sigma_rad=sigma[known],
            bottom_hidden=hidden[known],
        )
        better = known.copy()
        better[known] = again.known
        return located.put(better, again.select(again.known))

    def _forget(self, until_s: float) -> None:
        self._held = [part for part in self._held if (part[1].time_s > until_s).any()]
        oldest = until_s - FORGET_S
        self._headings = {t: seen for t, seen in self._headings.items() if seen[1] >= oldest}

    def _tracks(self, final: Smoothed) -> Tracks:
        """Smooth rows with what was seen at each of them."""
        with timed(self._run.timings, "smooth"):
            found = _joined(final, self._held)
            with_camera = shared_covariance(self._calibration, final.xy_m)
            heading, sigma = self._all_headings(final, found.heading, found.heading_sigma)
        return Tracks(
            track=final.track,
            class_name=final.class_name,
            time_s=final.time_s,
            frame=final.frame,
            xy_m=final.xy_m,
            covariance_m2=final.covariance_m2,
            shared_covariance_m2=with_camera,
            velocity_mps=final.velocity_mps,
            velocity_covariance=final.velocity_covariance,
            heading_rad=heading,
            heading_sigma_rad=sigma,
            box_xyxy=found.box_xyxy,
            keypoint_uv=found.keypoint_uv,
            keypoint_score=found.keypoint_score,
            score=found.score,
            observed=final.observed,
        )

    def _all_headings(
        self, final: Smoothed, shape: np.ndarray, shape_sigma: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Headings of the motion; where nothing moves, those of bodies and of vehicles' shapes.

        The shape of a vehicle does not tell front from back: the last motion does; where there was
        none, the spread is NaN.
        """
        moving = np.isfinite(final.heading_rad)
        heading = np.where(moving, final.heading_rad, shape)
        sigma = np.where(moving, final.heading_sigma_rad, np.abs(shape_sigma))
        axis = ~moving & (shape_sigma < 0)
        for row in np.flatnonzero(axis | moving):
            track = int(final.track[row])
            if moving[row]:
                self._headings[track] = float(heading[row]), float(final.time_s[row])
            elif track in self._headings:
                turned = np.cos(heading[row] - self._headings[track][0]) < 0
                heading[row] = np.angle(np.exp(1j * (heading[row] + np.pi * turned)))
                self._headings[track] = float(heading[row]), float(final.time_s[row])
            else:
                sigma[row] = np.nan
        return heading, sigma


@dataclass(frozen=True, eq=False)
class _Seen:
    """What was seen at smooth rows, NaN where a gap is bridged; axes have a negative spread."""

    box_xyxy: np.ndarray
    keypoint_uv: np.ndarray
    keypoint_score: np.ndarray
    score: np.ndarray
    heading: np.ndarray
    heading_sigma: np.ndarray


def _joined(final: Smoothed, held: list[tuple[int, Detections, Located]]) -> _Seen:
    k = max((len(d.keypoint_names) for _, d, _ in held), default=0)
    n = len(final)
    found = _Seen(
        np.full((n, 4), np.nan),
        np.full((n, k, 2), np.nan),
        np.full((n, k), np.nan),
        np.full(n, np.nan),
        np.full(n, np.nan),
        np.full(n, np.nan),
    )
    for first, d, located in held:
        rows = np.flatnonzero((final.source >= first) & (final.source < first + len(d)))
        source = final.source[rows] - first
        found.box_xyxy[rows] = d.box_xyxy[source]
        found.score[rows] = d.score[source]
        if len(d.keypoint_names):
            found.keypoint_uv[rows] = d.keypoint_uv[source]
            found.keypoint_score[rows] = d.keypoint_score[source]
        found.heading[rows] = located.heading_rad[source]
        sign = np.where(located.heading_is_axis[source], -1.0, 1.0)
        found.heading_sigma[rows] = sign * located.heading_sigma_rad[source]
    return found
