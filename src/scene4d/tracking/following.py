"""Streaming pipeline from detections to smoothed tracks: place, associate, smooth, filter."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.body import HALPE26
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import timed
from scene4d.core.tracks import VEHICLES, Located, Tracks
from scene4d.store.log import Look
from scene4d.tracking._association import GroundTracker
from scene4d.tracking._belief import FEWEST_SIGHTINGS, LEAST_REAL, Belief
from scene4d.tracking._colours import Colours
from scene4d.tracking._doubles import Doubles
from scene4d.tracking._fixed_lag import FixedLagSmoother
from scene4d.tracking._sightings import Sightings
from scene4d.tracking._sizes import Sizes
from scene4d.tracking._smoothing import Smoothed, SmoothingSettings, smooth
from scene4d.tracking._vehicles import locate_vehicles
from scene4d.tracking.placing import (
    bottoms_hidden,
    ground_under,
    located_on_levels,
    place,
    shared_covariance,
)

_MOTION_S = 10.0
"""A vehicle's rough heading rests on at most this much of what was seen before a look."""
_FORGET_S = 1800.0
"""A track's history is dropped this long after it was last seen. Standing vehicles are associated
for up to 600 s."""


def follow(
    looks: Iterable[Look],
    calibration: Calibration,
    person_height_m: float,
    *,
    trusted: bool,
    timings: dict[str, float] | None = None,
) -> Iterator[Tracks]:
    """Final rows of tracks, about every ten seconds, and the remaining ones at the end.

    Detections that have tracks keep them. If ``trusted`` (annotations), every track counts from
    the start. Memory does not grow with the length of the footage.
    """
    follower = _Follower(
        calibration,
        person_height_m,
        None if trusted else Belief(),
        {} if timings is None else timings,
    )
    for look in looks:
        yield from follower.follow(look)
    yield follower.finish()


def follow_live(
    looks: Iterable[Look],
    calibration: Calibration,
    person_height_m: float,
    *,
    timings: dict[str, float],
) -> Iterator[tuple[Tracks, Tracks]]:
    """For each look the rows that have become final, and all rows after them, which are
    provisional; at the end the remaining ones.
    """
    follower = _Follower(calibration, person_height_m, Belief(), timings)
    for look in looks:
        final = list(follower.follow(look))
        rest = follower.provisional()
        yield Tracks.concatenate(final) if final else rest.select(np.zeros(len(rest), bool)), rest
    last = follower.finish()
    yield last, last.select(np.zeros(len(last), bool))


class _Follower:
    """State of :func:`follow`; takes looks in order of time."""

    def __init__(
        self,
        calibration: Calibration,
        person_height_m: float,
        belief: Belief | None,
        timings: dict[str, float],
    ) -> None:
        assert calibration.camera is not None
        self._calibration = calibration
        self._person_height_m = person_height_m
        self._belief = belief
        self._timings = timings
        self._tracker = GroundTracker(camera=calibration.camera)
        self._doubles = Doubles()
        self._sizes = Sizes(calibration, person_height_m)
        self._colours = Colours()
        self._smoother = FixedLagSmoother()
        self._held: list[tuple[int, Detections, Located]] = []  # with the number of the first row
        self._rows = 0
        self._headings: dict[int, tuple[float, float]] = {}  # last heading in motion, and its time
        self._vehicles: list[Sightings] = []  # recent ones, in order of time

    def follow(self, look: Look) -> Iterator[Tracks]:
        """Add some frames."""
        seen, located = self._sightings(look)
        self._held.append((self._rows, look.detections, located))
        self._rows += len(seen)
        for frame, time_s, rows in look.frames():
            if self._belief is not None:
                with timed(self._timings, "believe"):
                    self._belief.add(time_s, seen.track[rows], look.detections.select(rows))
            with timed(self._timings, "smooth"):
                final = self._smoother.update(time_s, frame, seen.select(rows))
            if final is not None:
                yield self._tracks(final)
                self._forget(time_s - SmoothingSettings.lag_s)

    def provisional(self) -> Tracks:
        """The rows that are not yet final, as they are known so far."""
        before = dict(self._headings)
        with timed(self._timings, "smooth"):
            rest = self._smoother.provisional()
        found = self._tracks(rest)
        self._headings = before
        return found

    def finish(self) -> Tracks:
        """The remaining rows."""
        with timed(self._timings, "smooth"):
            final = self._smoother.finish()
        return self._tracks(final)

    def _sightings(self, look: Look) -> tuple[Sightings, Located]:
        """Ground positions and track numbers of all detections."""
        d = look.detections
        with timed(self._timings, "place"):
            hidden = bottoms_hidden(d)
            located = place(d, self._calibration, self._person_height_m, hidden)
        with timed(self._timings, "associate"):
            track, from_hiding = self._associate(look, located)
        with timed(self._timings, "place"):
            seen = _sightings(d, track, located, from_hiding)
            located = self._with_headings(d, seen, located, hidden)
            self._sizes.add(d, track, located)
            if look.colours is not None:
                self._colours.add(d, track, look.colours.astype(float))
        return _sightings(d, track, located, from_hiding), located

    def _associate(
        self, look: Look, located: Located
    ) -> tuple[Int[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
        """Track numbers of all rows, their own or else the tracker's; and who was hidden before."""
        detections = look.detections
        from_hiding = np.zeros(len(detections), bool)
        if (detections.track >= 0).all():
            return detections.track, from_hiding
        track = np.empty(len(detections), np.int64)
        for _, time_s, rows in look.frames():
            some, places = detections.select(rows), located.select(rows)
            numbers = self._tracker.update(
                time_s,
                some,
                places,
                None if look.appearance is None else look.appearance[rows].astype(float),
            )
            track[rows] = self._doubles.update(time_s, numbers, some.class_name, places)
            from_hiding[rows] = self._tracker.from_hiding
        return track, from_hiding

    def _with_headings(
        self, d: Detections, seen: Sightings, located: Located, hidden: Bool[np.ndarray, "n"]
    ) -> Located:
        """Positions, with moving vehicles placed again using their heading of motion."""
        rows = np.flatnonzero(np.isin(d.class_name, VEHICLES) & located.known)
        rough, mine = self._rough(seen.select(rows))
        heading, sigma = np.full((2, len(d)), np.nan)
        heading[rows[mine]] = rough.heading_rad
        sigma[rows[mine]] = rough.heading_sigma_rad
        known = np.isfinite(heading)
        if not known.any():
            return located
        heading, sigma, unseen = heading[known], sigma[known], hidden[known]
        vehicles = d.select(known)

        def on_one_ground(rows: Bool[np.ndarray, "n"], camera: Camera) -> Located:
            return locate_vehicles(
                vehicles.select(rows),
                camera,
                heading_rad=heading[rows],
                heading_sigma_rad=sigma[rows],
                bottom_hidden=unseen[rows],
            )

        again = located_on_levels(vehicles, self._calibration, on_one_ground)
        better = known.copy()
        better[known] = again.known
        return located.put(better, again.select(again.known))

    def _rough(self, vehicles: Sightings) -> tuple[Smoothed, Int[np.ndarray, "m"]]:
        """Smoothed rows of vehicles, and their numbers: the short look of a stream shows less of a
        motion than the ten seconds of a chunk of footage, and earlier ones are added to it.
        """
        newest = vehicles.time_s.max(initial=-np.inf)
        oldest = newest - _MOTION_S
        self._vehicles = [part for part in self._vehicles if (part.time_s > oldest).all()]
        earlier = sum(map(len, self._vehicles))
        self._vehicles.append(vehicles)
        found = smooth(Sightings.joined(self._vehicles))
        new = found.source >= earlier
        return found.select(new), found.source[new] - earlier

    def _forget(self, until_s: float) -> None:
        self._held = [part for part in self._held if (part[1].time_s > until_s).any()]
        oldest = until_s - _FORGET_S
        self._headings = {t: seen for t, seen in self._headings.items() if seen[1] >= oldest}
        if self._belief is not None:
            self._belief.forget(oldest)
        self._sizes.forget(oldest)
        self._colours.forget(oldest)

    def _tracks(self, final: Smoothed) -> Tracks:
        """Smoothed rows of the accepted tracks, with the detection behind each of them."""
        real = np.ones(len(final))
        if self._belief is not None:
            real = self._belief.probability(final.track)
            held = (real >= LEAST_REAL) & ~self._doubles.among(final.track)
            held &= self._belief.sightings(final.track) >= FEWEST_SIGHTINGS
            final, real = final.select(held), real[held]
        with timed(self._timings, "smooth"):
            found = _seen_at(final.source, self._held)
            with_camera = shared_covariance(self._calibration, final.xy_m)
            heading, sigma = self._all_headings(final, found)
            z_m, z_sigma_m = ground_under(self._calibration, final.xy_m)
            xyz_m = np.column_stack([final.xy_m, z_m])
            size_m, size_sigma_m = self._sizes.of(final.track, final.class_name, xyz_m, heading)
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
            existence_probability=real,
            z_m=z_m,
            z_sigma_m=z_sigma_m,
            size_m=size_m,
            size_sigma_m=size_sigma_m,
            colours=self._colours.of(final.track, final.class_name),
        )

    def _all_headings(self, final: Smoothed, found: "_Seen") -> tuple[np.ndarray, np.ndarray]:
        """Headings of motion, or of bodies and vehicle shapes where the object does not move.

        A vehicle's shape does not tell front from back; its last motion does. If it has not moved
        yet, the spread is NaN.
        """
        moving = np.isfinite(final.heading_rad)
        heading = np.where(moving, final.heading_rad, found.heading)
        sigma = np.where(moving, final.heading_sigma_rad, found.heading_sigma)
        axis = ~moving & found.heading_is_axis
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


def _sightings(
    d: Detections,
    track: Int[np.ndarray, "n"],
    located: Located,
    from_hiding: Bool[np.ndarray, "n"],
) -> Sightings:
    xy_m, covariance_m2 = located.xy_m, located.covariance_m2
    return Sightings(track, d.class_name, d.time_s, d.frame, xy_m, covariance_m2, from_hiding)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Detections behind smoothed rows, NaN where a gap is bridged."""

    box_xyxy: Float[np.ndarray, "n 4"]
    keypoint_uv: Float[np.ndarray, "n k 2"]
    keypoint_score: Float[np.ndarray, "n k"]
    score: Float[np.ndarray, "n"]
    heading: Float[np.ndarray, "n"]
    heading_sigma: Float[np.ndarray, "n"]
    heading_is_axis: Bool[np.ndarray, "n"]


def _seen_at(source: Int[np.ndarray, "n"], held: list[tuple[int, Detections, Located]]) -> _Seen:
    """Detections with the row numbers ``source`` (-1: none)."""
    k = max((len(d.keypoint_names) for _, d, _ in held), default=0)
    n = len(source)
    found = _Seen(
        box_xyxy=np.full((n, 4), np.nan),
        keypoint_uv=np.full((n, k, 2), np.nan),
        keypoint_score=np.full((n, k), np.nan),
        score=np.full(n, np.nan),
        heading=np.full(n, np.nan),
        heading_sigma=np.full(n, np.nan),
        heading_is_axis=np.zeros(n, bool),
    )
    for first, d, located in held:
        rows = np.flatnonzero((source >= first) & (source < first + len(d)))
        at = source[rows] - first
        found.box_xyxy[rows] = d.box_xyxy[at]
        found.score[rows] = d.score[at]
        if d.keypoint_names != HALPE26[: len(d.keypoint_names)]:
            raise InputError(
                "keypoints must be the first of Halpe's 26 in their order, such as COCO's 17"
            )
        if d.keypoint_names:
            found.keypoint_uv[rows] = d.keypoint_uv[at]
            found.keypoint_score[rows] = d.keypoint_score[at]
        found.heading[rows] = located.heading_rad[at]
        found.heading_sigma[rows] = located.heading_sigma_rad[at]
        found.heading_is_axis[rows] = located.heading_is_axis[at]
    return found
