"""From tracked boxes of vehicles to what the solver reads: moving ones, seen whole."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import HEIGHT, N_PARAMETERS, Points
from scene4d.calibration._case import ImageFrame
from scene4d.calibration._joint import distinct, orientation_grid, position_weights
from scene4d.calibration._prior import Prior
from scene4d.calibration._vehicles import KINDS, Vehicles
from scene4d.core.body import BORDER_PX
from scene4d.core.boxes import covered
from scene4d.core.people import Detections

_INPUT_PX, _LARGEST_SCALE = 640.0, 2.0
"""A detector sees a picture about this wide, or tiles of it: its errors are in its own pixels."""
_MIN_SIDE = 14.0
"""Smaller vehicles carry more noise than news: a motorway's cars of 10 to 14 of the detector's
pixels have boxes up to half too wide."""
_JITTER, _JITTER_SHARE = 1.0, 0.035
"""Standard deviation of a box's edge, in the detector's pixels; and the share of the box's width or
height by which detectors, and the shape of this vehicle against the typical one, are off (as in
``tracking``, where ``benchmarks/vehicle_positions.py`` measures it)."""
_MARGIN = 0.75
"""Standard deviation of the margin around all vehicles, in the detector's pixels."""
_CORRELATION = 0.7
"""Of a vehicle's errors in different places: its shape (0.03 of the box) stays, the detector's
jitter (0.02) does not."""
_CHORD = 0.7
"""A vehicle's direction is taken over so many of its sizes in the picture, where its box's jitter
turns it by 3 degrees. Chosen by hand."""
_TURN_SHARE = 0.04
"""Standard deviation, in sizes, of the chord's end across it: two boxes' jitter, and the drift of a
box's middle over the vehicle."""
_HIDDEN_SHARE = 0.05
"""A vehicle is hidden in part if a nearer one's box covers this share of its own. Chosen by hand:
less is within the boxes' jitter."""
_HEIGHTS_M = np.array([1.5, 2.5, 4.0, 6.5, 10.0, 16.0, 26.0])
"""Heights of the search: steps of 1.6, over what is plausible."""
_STARTS = 4
_ROUGH, _ROUGH_NOISE, _ROUGH_ROUNDS = 16, 2.0, 3
"""So many vehicles tell good starting points from bad ones, at so many times the noise: half a step
of the grid."""
_BATCH = 100
"""Cameras at once: their arrays fit in the processor's cache."""
_MOST_SIGHTINGS, _MOST_TRACKS = 5, 40
"""More sightings of one vehicle repeat its errors; more vehicles would tell more of what all share
than is known of it."""


@dataclass(frozen=True, eq=False)
class Traffic:
    """The moving vehicles of one camera: their sightings in pixels, and the solver's term."""

    detections: Detections
    vehicles: Vehicles
    frame: ImageFrame

    @classmethod
    def of(cls, detections: Detections | None, frame: ImageFrame) -> "Traffic | None":
        """Of tracked detections (sorted by time), the vehicles that move and are seen whole, a few
        sightings of each; None where there is none.

        Vehicles that stand have no direction. Those cut by the image's border, or partly behind a
        nearer one, are left out while they are.
        """
        if detections is None:
            return None
        whole = _whole(detections)
        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, str]] = []
        for track in np.unique(detections.track[detections.track >= 0]):
            rows = np.flatnonzero(detections.track == track)
            kind = _kind(detections, rows)
            if kind in KINDS:
                rows, back, front = _chords(detections.box_xyxy, rows[whole[rows]])
                if len(rows):
                    parts.append((rows, back, front, kind))
        parts = sorted(parts, key=lambda part: -len(part[0]))[:_MOST_TRACKS]
        if not parts:
            return None
        rows = np.concatenate([part[0] for part in parts])
        track = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        back, front = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
        kinds = tuple(part[3] for part in parts)
        vehicles = _in_frame(detections.box_xyxy[rows], back, front, track, kinds, frame)
        return cls(detections.select(rows), vehicles, frame)

    def __len__(self) -> int:
        """How many different vehicles these are."""
        return len(self.vehicles.kind)

    @property
    def uprights(self) -> Points:
        """From the bottom to the top of the boxes, as of people."""
        x1, y1, x2, y2 = self.detections.box_xyxy.T
        foot, head = (self.frame.straight(np.stack([(x1 + x2) / 2, y], axis=1)) for y in (y2, y1))
        return Points(foot, head, np.ones(len(x1), bool), 0.0)

    def starts(self, prior: Prior, keep: int = _STARTS) -> Float[np.ndarray, "m 7"]:
        """The best ``keep`` distinct cameras of the solver's grid, with heights, best first."""
        parameters = np.tile(orientation_grid(prior), (len(_HEIGHTS_M), 1, 1))
        parameters[..., HEIGHT] = np.log(_HEIGHTS_M)[:, None]
        parameters = parameters.reshape(-1, N_PARAMETERS)
        cost = self._rough_costs(parameters) + prior.costs(parameters)
        return parameters[distinct(parameters, np.argsort(cost), keep)]

    def _rough_costs(self, parameters: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k"]:
        """The cost at many cameras from one sighting of each of a few vehicles, at larger noise."""
        vehicles = self.vehicles
        ends = np.append(vehicles.starts[1:], len(vehicles.track))
        middle = (vehicles.starts + ends) // 2
        few = middle[:: max(1, len(middle) // _ROUGH)]
        rough = replace(vehicles.select(few), sigma=_ROUGH_NOISE * vehicles.sigma[few])
        parts = np.array_split(parameters, max(1, len(parameters) // _BATCH))
        return np.concatenate([rough.fitted(part, _ROUGH_ROUNDS).cost for part in parts])


def joined(people: Points, vehicles: Points) -> Points:
    """The points of both."""
    return replace(
        people,
        foot=np.hstack([people.foot, vehicles.foot]),
        head=np.hstack([people.head, vehicles.head]),
        from_box=np.concatenate([people.from_box, vehicles.from_box]),
    )


def _detector_px(image_size: tuple[int, int]) -> float:
    """Pixels of the footage per pixel that the detector sees."""
    return float(np.clip(image_size[0] / _INPUT_PX, 1.0, _LARGEST_SCALE))


def _kind(detections: Detections, rows: np.ndarray) -> str:
    """The class that most of a track's scores are for."""
    names, which = np.unique(detections.class_name[rows], return_inverse=True)
    return str(names[np.bincount(which, detections.score[rows]).argmax()])


def _whole(detections: Detections) -> Bool[np.ndarray, "n"]:
    """Which boxes are not cut by the border, large enough, and not behind a nearer one."""
    box = detections.box_xyxy
    size = np.array(detections.image_size)
    margin = np.maximum(BORDER_PX, 0.004 * size)
    whole = np.asarray((box[:, :2] > margin).all(axis=1))
    whole &= (box[:, 2:] < size - 1 - margin).all(axis=1)
    whole &= (box[:, 2:] - box[:, :2] >= _MIN_SIDE * _detector_px(detections.image_size)).all(
        axis=1
    )
    for frame in np.unique(detections.frame):
        rows = np.flatnonzero(detections.frame == frame)
        here = box[rows]
        share = covered(here[:, None], here[None])
        nearer = here[None, :, 3] > here[:, None, 3]
        whole[rows] &= ~((share > _HIDDEN_SHARE) & nearer).any(axis=1)
    return whole


def _chords(box: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of one track, the sightings (at most ``_MOST_SIGHTINGS``, spread over its way) between a
    place well before and one as long after, and the middles of its boxes there.
    """
    middle = (box[rows, :2] + box[rows, 2:]) / 2
    size = np.sqrt((box[rows, 2:] - box[rows, :2]).prod(axis=1))
    found = []
    for i in range(1, len(rows) - 1):
        for reach in range(1, min(i, len(rows) - 1 - i) + 1):
            if np.hypot(*(middle[i + reach] - middle[i - reach])) > _CHORD * size[i]:
                found.append((i, i - reach, i + reach))
                break
    if not found:
        return rows[:0], middle[:0], middle[:0]
    chosen = np.array(found)
    if len(chosen) > _MOST_SIGHTINGS:
        way = np.cumsum(
            np.hypot(
                *np.diff(middle[chosen[:, 0]], axis=0, prepend=np.nan).T / size[chosen[:, 0]]
            ).clip(0)[1:]
        )
        way = np.concatenate([[0.0], way])
        at = np.searchsorted(way, np.linspace(0, way[-1], _MOST_SIGHTINGS))
        chosen = chosen[np.unique(np.minimum(at, len(chosen) - 1))]
    return rows[chosen[:, 0]], middle[chosen[:, 1]], middle[chosen[:, 2]]


def _in_frame(
    box: Float[np.ndarray, "n 4"],
    back: Float[np.ndarray, "n 2"],
    front: Float[np.ndarray, "n 2"],
    track: np.ndarray,
    kinds: tuple[str, ...],
    frame: ImageFrame,
) -> Vehicles:
    """The vehicles in the solver's frame, from pixels of the footage."""
    unit = frame.half_diagonal_px
    side = np.tile(box[:, 2:] - box[:, :2], 2)
    detector_px = _detector_px(frame.image_size)
    sigma = np.hypot(_JITTER * detector_px, _JITTER_SHARE * side) / unit
    x1, y1, x2, y2 = box.T
    mid_x, mid_y = (x1 + x2) / 2, (y1 + y2) / 2
    ends = np.stack([[x1, mid_y], [mid_x, y1], [x2, mid_y], [mid_x, y2]]).transpose(2, 0, 1)
    on_edge = frame.straight(ends.reshape(-1, 2)).T.reshape(ends.shape)
    axis = _axes(frame, ends)
    middle, back_, front_ = (
        frame.straight(uv).T for uv in (np.stack([mid_x, mid_y], 1), back, front)
    )
    chord = front_ - back_
    across = np.stack([-chord[:, 1], chord[:, 0]], 1) / np.hypot(*chord.T)[:, None]
    size = np.sqrt((box[:, 2:] - box[:, :2]).prod(axis=1)) / unit
    foot = frame.straight(np.stack([mid_x, y2], 1))
    return Vehicles(
        edge=(axis * on_edge).sum(axis=-1),
        axis=axis,
        sigma=sigma,
        middle=middle,
        back=back_,
        front=front_,
        turn=_TURN_SHARE * size[:, None] * across,
        margin=np.full(len(box), _MARGIN * detector_px / unit),
        track=track,
        weight=position_weights(foot, size, track, _CORRELATION),
        kind=kinds,
    )


def _axes(frame: ImageFrame, ends: np.ndarray) -> np.ndarray:
    """Directions (n, 4, 2) along which edges at ``ends`` (n, 4, 2) are measured, in units of the
    footage: across the edges, where a known lens has bent and stretched them.
    """
    axes = np.zeros_like(ends)
    axes[:, [0, 2], 0] = axes[:, [1, 3], 1] = 1.0
    if frame.lens is None:
        return axes
    slope = np.empty((*ends.shape, 2))
    for j in range(2):
        step = np.zeros(2)
        step[j] = 0.5
        there = [frame.straight((ends + s).reshape(-1, 2)).T for s in (step, -step)]
        slope[..., j] = (there[0] - there[1]).reshape(ends.shape) * frame.half_diagonal_px
    return (axes[..., None, :] @ np.linalg.inv(slope))[..., 0, :]
