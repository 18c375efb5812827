"""Who comes into view and who is gone, when neither the picture's border nor an obstacle says why.

An end of a track proves little by itself: people walk out of the picture, or behind something.
What is judged of each end is the last (or first) box that was seen, and where its motion in the
picture would have carried it half a second later (or earlier):

- *border*: how far the sides of both boxes keep from the sides of the picture, in units of the
  box's size ``√(w h)``: ``Φ((margin - 0.1) / 0.05)``;
- *hidden*: for every other object in view then, the share of either box that its box covers,
  ``Φ((share - 0.5) / 0.15)``, times the probability that it stands before a, that is lower in the
  picture: ``Φ((bottom - bottom_a) / (0.05 h_a))``;
- *clip*: an end within about half a second of the stage's own is none:
  ``1 - exp(-½ (gap / ½ s)²)``;
- *leaving*, where it is asked what a went into: things at the picture's border are entered too. Who
  goes through the border moves outwards, by more than 0.15 ± 0.05 of the box's size in the half
  second; who does not is not explained by it;
- *within*, where it is asked what a went into: the share of the last box that b's box covers then,
  ``Φ((share - 0.7) / 0.15)``. What is inside a thing is seen inside its outline, from anywhere.

They rest on pixels alone, and so on no calibration. What a went into is judged by what followed and
by its posture as well:

- *afterwards*: how much likelier what followed is if a is still about (:mod:`._afterwards`);
- *driving off*: b does so soon (:func:`drives_ratio`);
- *posture*: who gets in bends, and the door hides the legs: of those who get in 65 % are seen less
  tall at the end, of others 10 %. Who boards a bus need not: posture counts as far as the vehicle
  is not tall enough to stand in, which its height and the person's say.

Constants are rules of thumb, chosen by hand before any footage was searched; those of *leaving*,
*within* and *posture* and the share of ends within an outline that are entries were chosen on the
tuning cameras (MEVA G341 and G424).
"""

from dataclasses import dataclass
from weakref import WeakKeyDictionary, proxy

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.body import BORDER_PX
from scene4d.core.boxes import covered
from scene4d.searching.predicates._afterwards import BEFORE_SIGMA, Afterwards, Ends, enough
from scene4d.searching.predicates._gaussian import ndtr
from scene4d.searching.predicates._meeting import expand
from scene4d.searching.predicates._posture import stooping
from scene4d.searching.predicates._riding import drives_ratio, riding, within
from scene4d.searching.predicates.stage import Stage, StageRows, all_finite

# Means and softness of the factors above: times in seconds, lengths as shares of a box's size.
_END_SIGMA_S = 1.0
_LOOK_S = 0.5
_BORDER_SHARE, _BORDER_SIGMA = 0.1, 0.05
_LEAVING_SHARE, _LEAVING_SIGMA = 0.15, 0.05
_CLIP_SIGMA_S = 0.5
_ENTRIES = 0.5
"""Share of the ends within a vehicle's outline that are entries: 149 of 324 on the tuning cameras
(ends of which border, clip, hidden and within leave 0.3 or more)."""
_STOOPS_IN, _STOOPS_ELSE = 0.8, 0.05
"""P(seen less tall at the end): of those who get in, and of others."""
_HEADROOM_M, _HEADROOM_SIGMA_M = 0.6, 0.15
"""A vehicle that is so much taller than a person is entered upright: its floor is 0.35 m above the
road (at most 0.34 m at a city bus's door, UNECE regulation 107), its roof 0.2 m thick."""
_BOARDED = ("bus",)
"""Classes that are entered upright where heights are not known."""


def disappears(a: StageRows, *, sigma_s: float = _END_SIGMA_S) -> Float[np.ndarray, "m"]:
    """P(a is gone from view at about this moment, inside the picture and behind nothing).

    ``exp(-½ (t - t_end)² / σ²)`` with the moment t_end at which a was last seen, times the factors
    *border*, *clip* and ``1 - max(hidden)`` of this module. Whatever covers a counts as an
    obstacle, a parked vehicle too: who walks behind it is not gone. Who enters it is covered by it
    as well, for that see :func:`disappears_into`. NaN where a was never seen in the picture.
    """
    return _end(a, None, True, sigma_s)


def appears(a: StageRows, *, sigma_s: float = _END_SIGMA_S) -> Float[np.ndarray, "m"]:
    """P(a comes into view at about this moment, inside the picture and from behind nothing):
    :func:`disappears` with time reversed.
    """
    return _end(a, None, False, sigma_s)


def disappears_into(
    a: StageRows, b: StageRows, *, sigma_s: float = _END_SIGMA_S
) -> Float[np.ndarray, "m"]:
    """P(a has got into b at about this moment): its end is within b's outline, nothing but b hides
    it, and nothing later says that it is still about.

    The bell of :func:`disappears` times the probability by Bayes' rule of three explanations of
    the end. With e the product of *leaving*, *clip* and ``1 - max(hidden)`` (b is no obstacle: who
    gets in on its far side is covered by it), i *within*, ½ the share of such ends that are
    entries, S the likelihood ratio of the posture, D that of b's driving off soon and L that of
    what followed:

        a is inside b           ½ e i S D
        left or hid elsewhere   1 - e
        still about, or lost    e (1 - ½ i) L

    That it was near on the ground is a predicate of its own. NaN where b was never seen.
    """
    return _end(a, b, True, sigma_s)


def appears_from(
    a: StageRows, b: StageRows, *, sigma_s: float = _END_SIGMA_S
) -> Float[np.ndarray, "m"]:
    """P(a has come out of b at about this moment): :func:`disappears_into` with time reversed."""
    return _end(a, b, False, sigma_s)


@dataclass(frozen=True, eq=False)
class _Ends:
    """One end of every track: its moment, the box then, what speaks for it, and the two that hide
    it most.

    ``row`` is that of the stage, -1 where there is none. ``free`` is by the border and the clip,
    ``still`` the same of what does not leave. ``whom`` is the position of the hiding track in the
    stage, -1 for none; ``touched`` the largest share that any other covers, before it or behind it.
    ``seen`` are the rows of the stage that show a box.
    """

    row: Int[np.ndarray, "t"]
    time_s: Float[np.ndarray, "t"]
    box_xyxy: Float[np.ndarray, "t 4"]
    free: Float[np.ndarray, "t"]
    still: Float[np.ndarray, "t"]
    hidden: Float[np.ndarray, "t 2"]
    whom: Int[np.ndarray, "t 2"]
    touched: Float[np.ndarray, "t"]
    seen: Int[np.ndarray, "n"]


_KEPT: "WeakKeyDictionary[Stage, dict[bool, _Ends]]" = WeakKeyDictionary()
"""Ends belong to the stage alone: they are judged once for all predicates that ask."""


def _kept(stage: Stage, last: bool) -> _Ends:
    kept = _KEPT.setdefault(stage, {})
    if last not in kept:
        kept[last] = _ends(stage, last)
    return kept[last]


def unexplained_ends(
    stage: Stage, last: bool
) -> tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Row of the end (or begin) of each track that was seen, and P(neither border, clip nor
    obstacle explains it): what :func:`disappears` (or :func:`appears`) is there.
    """
    ends = _kept(stage, last)
    track = np.flatnonzero(ends.row >= 0)
    return ends.row[track], ends.free[track] * (1 - ends.hidden[track, 0])


def _end(a: StageRows, b: StageRows | None, last: bool, sigma_s: float) -> np.ndarray:
    ends, track = _kept(a.stage, last), a.stage.track_of_row[a.index]
    bump = np.exp(-(((a.time_s - ends.time_s[track]) / sigma_s) ** 2) / 2)
    if b is None:
        return np.asarray(bump * ends.free[track] * (1 - ends.hidden[track, 0]))
    other = b.stage.track_of_row[b.index]
    hidden = np.where(ends.whom[track, 0] == other, ends.hidden[track, 1], ends.hidden[track, 0])
    share = covered(ends.box_xyxy[track], _nearest_box(b.stage, other, ends.time_s[track]))
    is_within = within(share)
    left_to_it = ends.still[track] * (1 - hidden)
    upright = _upright_inside(a, b)
    posture = upright + (1 - upright) * _posture_ratio(a.stage, ends, track)
    pair, number = np.unique(track * len(ends.row) + other, return_inverse=True)
    moment = ends.time_s[pair // len(ends.row)]
    drives = drives_ratio(b.stage, pair % len(ends.row), np.nan_to_num(moment), last)[number]
    inside = _ENTRIES * left_to_it * is_within * posture * drives
    about = left_to_it * (1 - _ENTRIES * is_within) * _afterwards(a.stage, last).ratio(track)
    return np.asarray(bump * inside / (inside + 1 - left_to_it + about))


_FOLLOWED: "WeakKeyDictionary[Stage, dict[bool, Afterwards]]" = WeakKeyDictionary()


def _afterwards(stage: Stage, last: bool) -> Afterwards:
    followed = _FOLLOWED.setdefault(stage, {})
    if last not in followed:
        # Without keeping the stage alive.
        ends, others = _of_people(stage, last), _of_people(stage, not last)
        followed[last] = Afterwards(proxy(stage), ends, others, last)
    return followed[last]


def _of_people(stage: Stage, last: bool) -> Ends:
    ends = _kept(stage, last)
    people = stage.tracks.class_name[stage.first_row] == "person"
    track = np.flatnonzero(people & (ends.row >= 0))
    alone = 1 - enough(ends.touched[track])
    # Those who are seen through a window of the vehicle that covers them are inside, not about.
    covers = np.hstack([_kept(stage, end).whom[track] for end in (True, False)])
    rides = np.max([riding(stage, track, vehicle) for vehicle in covers.T], axis=0)
    return Ends(ends.row[track], track, np.nan_to_num(ends.free[track]) * alone, 1 - rides)


def _upright_inside(a: StageRows, b: StageRows) -> Float[np.ndarray, "m"]:
    """P(a can stand in b), by their heights; where these are not known by b's class."""
    (tall, tall_sigma), (own, own_sigma) = (
        (rows.size_m[:, 2], rows.size_sigma_m[:, 2]) for rows in (b, a)
    )
    sigma = np.sqrt(_HEADROOM_SIGMA_M**2 + tall_sigma**2 + own_sigma**2)
    stands = ndtr((tall - own - _HEADROOM_M) / sigma)
    boarded = np.isin(b.stage.tracks.class_name[b.index], _BOARDED)
    return np.where(np.isfinite(stands), stands, boarded.astype(float))


def _posture_ratio(
    stage: Stage, ends: _Ends, track: Int[np.ndarray, "m"]
) -> Float[np.ndarray, "m"]:
    """How much likelier the heights at tracks' ends are of somebody who gets in; 1 if unknown."""
    own, number = np.unique(track, return_inverse=True)
    there = np.flatnonzero(ends.row[own] >= 0)
    early, late = stage.window(ends.row[own[there]], _LOOK_S)
    owner, rows = expand(early, late - early + 1)
    stoops = stooping(stage.rows(rows))
    known = np.isfinite(stoops)
    count = np.bincount(owner[known], minlength=len(there))
    total = np.bincount(owner[known], stoops[known], len(there))
    mean = total[count > 0] / count[count > 0]
    out = np.ones(len(own))
    out[there[count > 0]] = (_STOOPS_IN * mean + (1 - _STOOPS_IN) * (1 - mean)) / (
        _STOOPS_ELSE * mean + (1 - _STOOPS_ELSE) * (1 - mean)
    )
    return out[number]


def _ends(stage: Stage, last: bool) -> _Ends:
    tracks, count = stage.tracks, len(stage.first_row)
    time_s, free, still = np.full((3, count), np.nan)
    box = np.full((count, 4), np.nan)
    hidden, whom = np.zeros((count, 2)), np.full((count, 2), -1)
    at, touched = np.full(count, -1), np.zeros(count)
    seen = np.flatnonzero(tracks.observed & all_finite(tracks.box_xyxy))
    if not len(seen):
        return _Ends(at, time_s, box, free, still, hidden, whom, touched, seen)
    owner = stage.track_of_row[seen]
    changes = owner[1:] != owner[:-1]
    row = seen[np.append(changes, True) if last else np.append(True, changes)]
    track = stage.track_of_row[row]
    at[track] = row
    time_s[track], box[track] = tracks.time_s[row], tracks.box_xyxy[row]
    now, then = box[track], _carried_on(stage, row, last)
    size = np.sqrt(np.maximum((now[:, 2] - now[:, 0]) * (now[:, 3] - now[:, 1]), 1.0))
    margins = [_margin(one, stage.image_size) / size for one in (now, then)]
    border = ndtr((np.minimum(*margins) - _BORDER_SHARE) / _BORDER_SIGMA)
    outwards = ndtr((margins[0] - margins[1] - _LEAVING_SHARE) / _LEAVING_SIGMA)
    everything = stage.span_s[1 if last else 0]
    clip = 1 - np.exp(-(((time_s[track] - everything) / _CLIP_SIGMA_S) ** 2) / 2)
    free[track], still[track] = border * clip, (1 - (1 - border) * outwards) * clip
    hidden[track], whom[track], touched[track] = _hidden(stage, row, seen, (now, then))
    return _Ends(at, time_s, box, free, still, hidden, whom, touched, seen)


def _nearest_box(
    stage: Stage, track: Int[np.ndarray, "m"], time_s: Float[np.ndarray, "m"]
) -> Float[np.ndarray, "m 4"]:
    """Boxes of tracks at the moments nearest to given ones at which they were seen; else NaN."""
    seen = _kept(stage, True).seen
    box = np.full((len(track), 4), np.nan)
    if not len(seen):
        return box
    line, wanted = stage.line_s[seen], stage.on_line(track, np.nan_to_num(time_s))
    late = np.minimum(np.searchsorted(line, wanted), len(seen) - 1)
    early = np.maximum(late - 1, 0)
    nearer = np.abs(line[early] - wanted) < np.abs(line[late] - wanted)
    row = np.where(nearer, early, late)
    mine = np.flatnonzero(stage.track_of_row[seen[row]] == track)
    box[mine] = stage.tracks.box_xyxy[seen[row[mine]]]
    return box


def _carried_on(stage: Stage, row: np.ndarray, last: bool) -> np.ndarray:
    """The boxes half a second on, by their motion in the picture over the half second before."""
    tracks = stage.tracks
    early, late = stage.window(row, _LOOK_S)
    from_row = early if last else late
    # Where that row was bridged there is no box, and the motion is unknown: none.
    before = tracks.box_xyxy[from_row]
    taken = np.abs(tracks.time_s[row] - tracks.time_s[from_row])
    now = tracks.box_xyxy[row]
    way = now - before
    corner = np.array(stage.image_size) - 1 - BORDER_PX
    # Where the border cuts a side, the opposite one tells the motion.
    cut = np.hstack([now[:, :2] <= BORDER_PX, now[:, 2:] >= corner])
    weight = np.where(cut & ~cut[:, [2, 3, 0, 1]], 0.0, 1.0)
    moved = weight * way + (weight * way)[:, [2, 3, 0, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = moved / (weight + weight[:, [2, 3, 0, 1]]) * (_LOOK_S / taken)[:, None]
    return np.asarray(now + np.where(np.isfinite(shift), shift, 0.0))


def _margin(box: np.ndarray, image_size: tuple[int, int]) -> np.ndarray:
    """Smallest distance of a box's sides from those of the picture, pixels; negative outside."""
    width, height = image_size
    sides = [box[:, 0], box[:, 1], width - 1 - box[:, 2], height - 1 - box[:, 3]]
    return np.asarray(np.minimum.reduce(sides))


def _hidden(
    stage: Stage, row: np.ndarray, seen: np.ndarray, boxes: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P(hidden) of every end by the two objects that hide it most, their tracks, and how much any
    other covers of it.
    """
    tracks = stage.tracks
    hidden, whom = np.zeros((len(row), 2)), np.full((len(row), 2), -1)
    touched, time = np.zeros(len(row)), tracks.time_s[row]
    order = np.argsort(time, kind="stable")
    # Which ends fall within half a step of every row that was seen?
    reach, at = 0.501 * stage.step_s, tracks.time_s[seen]
    low = np.searchsorted(time[order], at - reach)
    count = np.searchsorted(time[order], at + reach, side="right") - low
    owner, position = expand(low, count)
    if not len(owner):
        return hidden, whom, touched
    other, end = seen[owner], order[position]
    foreign = stage.track_of_row[other] != stage.track_of_row[row[end]]
    other, end = other[foreign], end[foreign]
    box = tracks.box_xyxy[other]
    share = np.maximum(*(covered(part[end], box) for part in boxes))
    np.maximum.at(touched, end, share)
    now = boxes[0][end]
    depth = (box[:, 3] - now[:, 3]) / (BEFORE_SIGMA * np.maximum(now[:, 3] - now[:, 1], 1.0))
    value = enough(share) * ndtr(depth)
    value[share == 0] = 0.0
    by = stage.track_of_row[other]
    # Largest first within every end; an object counts once.
    for rank in range(2):
        best = np.zeros(len(row))
        np.maximum.at(best, end, value)
        top = (value == best[end]) & (value > 0)
        hidden[:, rank] = best
        whom[end[top], rank] = by[top]
        value = np.where(by == whom[end, rank], 0.0, value)
    return hidden, whom, touched
