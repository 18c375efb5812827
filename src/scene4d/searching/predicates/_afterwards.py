"""What followed the end of a track: was he seen again, or would he have been, had he walked on?

Whose track ended has got into something, or was only lost from view. What follows is weighed by

    L = P(what followed | he is still about) / P(what followed | he is inside).

Who is still about walks away, at once or after a while, in any direction, or stays: a fan of ways
(:func:`_ways`) from where he was last seen. On each of them, second by second, he is seen with the
probability that his place is in the picture, that nothing nearer covers it, and that he is as tall
there as people are who are tracked. So whoever may stand behind a parked vehicle is not missed
until it drives off, and after the end of the footage nothing is missed.

- *Never seen*: the product of ``1 - p`` over the seconds that follow, the mean over the ways. It is
  1 where only some people are tracked (:attr:`Stage.everybody`).
- *Seen again*: any person's track that begins afterwards may be his, if it is not seen within a
  vehicle and moves along with it (:mod:`._riding`). With F the density of the ways
  at its place and time over the density of all such begins, ``F / (1 + κ F)``: of a share κ of
  those who get in, somebody else begins nearby just then (a driver gets out, a friend comes along).
- *Lost for good*: trackers lose people in plain view too, and annotators stop. The share q is
  counted in the footage itself, over the ends that nothing explains, with a Beta prior.

``L = q + (1 - q) (never + Σ again)``; L is 1 where nothing is known. With time reversed the same is
said of the begin of a track: he had been nowhere before.
"""

from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.boxes import covered
from scene4d.searching.predicates._gaussian import ndtr
from scene4d.searching.predicates._meeting import expand
from scene4d.searching.predicates.stage import Stage, all_finite, upright_uv

# Chosen by hand before any footage was searched with them, except where it is said.
_SPEEDS_MPS = (0.7, 1.4)
"""A stroll, and somebody who walks somewhere."""
_DIRECTIONS = 8
_WAITS_S = (0, 3, 10, 30)
_WAIT_SHARES = (0.5, 0.15, 0.1, 0.1)
"""How many walk on after such a pause; the others stay where they are."""
_LOOKS = 60
"""Seconds that are looked at, one by one: whoever is about has mostly shown himself by then."""
_SPREAD_M = 0.5
_FAN_SPREAD = 0.4
"""Distance of somebody from his way: so much, and this share of its length, as ways diverge."""
_BEFORE_S = 1.0
"""A track that takes over may begin so long before the end of the one that it takes over."""
_SEEN_MOST = 0.8
"""P(seen) of a second in full view: who is overlooked once is easily overlooked again."""
_SEEN_SHARE, _SEEN_SIGMA = 0.5, 0.15
"""Share of an upright person that must be in view, and how sharply."""
BEFORE_SIGMA = 0.05
"""How sharply the nearer of two is known by the lower edges of their boxes, in heights."""
_WIDTH_SHARE = 0.35
"""Width of an upright person over the height."""
_SMALL_QUANTILE = 0.05
_SMALL_SHARE = 0.1
"""People are looked for where they are as tall as all but 5 % of those who are tracked, or a tenth
of the picture: detectors see the whole picture with 400 pixels and more."""
_LOST, _KEPT = 1.0, 4.0
"""Prior counts of who is lost for good in plain view, and who is not."""
_AROUND_M = 5.0
"""How far about where one track begins others are as likely to."""
_COMPANY = 1.0
"""κ above: as often as not. Chosen on the tuning cameras (MEVA G341 and G424); 0.25 is 0.006 worse
there in average precision."""
_OPEN_LEAST = 0.05
_MOST_WEIGHED = 100
"""So many open ends, spread over all, tell how often somebody is lost: a rate of 0.2 to 0.04. A day
has thousands, and weighing one takes 5 ms."""


@dataclass(frozen=True, eq=False)
class Ends:
    """Where people's tracks end, or begin: the row in the stage, the track's position in it, and
    ``open``: P(no border and no other object explains it). ``about``: P(the track is of somebody
    who is not seen inside a vehicle that he rides along in).
    """

    row: Int[np.ndarray, " e"]
    track: Int[np.ndarray, " e"]
    open: Float[np.ndarray, " e"]
    about: Float[np.ndarray, " e"]


@dataclass(eq=False)
class Afterwards:
    """What followed the ends of people's tracks, and where such tracks began; with ``last`` False,
    what came before they began, and where others ended. Worked out when it is first asked for.
    """

    stage: Stage
    ends: Ends
    others: Ends
    last: bool
    _weighed: dict[int, tuple[float, float]] = field(default_factory=dict)

    def ratio(self, track: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
        """L of tracks, by their position in the stage; 1 where nothing is known."""
        out = np.ones(len(track))
        if self.stage.camera is None:
            return out
        lost = self.lost
        for one in np.intersect1d(track, self.ends.track):
            never, again = self._weigh(int(one))
            out[track == one] = lost + (1 - lost) * (never + again)
        return out

    @cached_property
    def lost(self) -> float:
        """q: P(somebody in plain view is lost for good), by the open ends."""
        lost, kept = _LOST, _KEPT
        usual = _LOST / (_LOST + _KEPT)
        rows = np.flatnonzero(self.ends.open >= _OPEN_LEAST)
        if len(rows) > _MOST_WEIGHED:
            rows = rows[np.linspace(0, len(rows) - 1, _MOST_WEIGHED).astype(int)]
        for row in rows:
            never, again = self._weigh(int(self.ends.track[row]))
            missed = self.ends.open[row] * self.ends.about[row] * (1 - never)
            back = again / (again + usual)
            lost, kept = lost + missed * (1 - back), kept + missed * back
        return lost / (lost + kept)

    def _weigh(self, track: int) -> tuple[float, float]:
        """P(never seen had he walked on), and the sum over all begins of those times that they are
        likelier his than by chance.
        """
        if track not in self._weighed:
            row = int(self.ends.row[self.ends.track == track][0])
            known = bool(np.isfinite(self.stage.tracks.xy_m[row]).all())
            self._weighed[track] = self._followed(row) if known else (1.0, 0.0)
        return self._weighed[track]

    def _followed(self, row: int) -> tuple[float, float]:
        tracks, sign = self.stage.tracks, 1.0 if self.last else -1.0
        reached_m, place, share = _ways()
        time_s = tracks.time_s[row] + sign * np.arange(1, _LOOKS + 1)
        seen = _SEEN_MOST * self._visible(tracks.xy_m[row] + reached_m, place, time_s)
        unseen = np.vstack([np.ones(len(share)), np.cumprod(1 - seen, axis=0)])
        since = sign * (tracks.time_s[self.others.row] - tracks.time_s[row])
        mine = self.stage.track_of_row[row] == self.others.track
        later = np.flatnonzero(~mine & (since > -_BEFORE_S) & (since <= _LOOKS))
        look = np.clip(np.ceil(since[later]).astype(int) - 1, 0, _LOOKS - 1)
        first_seen = (unseen[look] - unseen[look + 1]) * share
        other = self.others.row[later]
        away_m = tracks.xy_m[other] - tracks.xy_m[row]
        apart_m2 = _squares_m2(away_m, reached_m)[np.arange(len(later))[:, None], place[look]]
        errors = np.trace(tracks.covariance_m2[other] + tracks.covariance_m2[row], 0, 1, 2) / 2
        spread_m2 = _SPREAD_M**2 + (_FAN_SPREAD * np.linalg.norm(reached_m, axis=1)) ** 2
        variance = spread_m2[place[look]] + errors[:, None]
        bell = np.exp(-apart_m2 / (2 * variance)) / (2 * np.pi * variance)
        likelier = np.nan_to_num((first_seen * bell).sum(axis=1) / self._chance(other))
        again = self.others.about[later] * likelier / (1 + _COMPANY * likelier)
        never = float(share @ unseen[-1]) if self.stage.everybody else 1.0
        return never, float(again.sum())

    def _chance(self, rows: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Density at which people's tracks begin at the places of some rows, by square metre and
        second: one anywhere, over the ellipse of two standard deviations that everybody's places
        fill, and all others about where they begin: a bus stop sees more than a lawn.
        """
        tracks, begins = self.stage.tracks, self.others.row
        apart_m2 = _squares_m2(tracks.xy_m[rows], tracks.xy_m[begins])
        bell = np.exp(-apart_m2 / (2 * _AROUND_M**2)) / (2 * np.pi * _AROUND_M**2)
        about = np.where(rows[:, None] == begins, 0.0, np.nan_to_num(bell)).sum(axis=1)
        return np.asarray((1 / self._area_m2 + about) / max(np.diff(self.stage.span_s)[0], 1.0))

    @cached_property
    def _area_m2(self) -> float:
        xy = self.stage.tracks.xy_m
        known = xy[all_finite(xy)]
        return 4 * np.pi * np.sqrt(max(float(np.linalg.det(np.cov(known.T))), 1.0))

    def _visible(
        self,
        xy_m: Float[np.ndarray, "p 2"],
        place: Int[np.ndarray, "s w"],
        time_s: Float[np.ndarray, " s"],
    ) -> Float[np.ndarray, "s w"]:
        """P(somebody upright is in view) at places, by their numbers, and times; 0 outside the
        footage.
        """
        box = self._upright(xy_m)
        tall = box[:, 3] - box[:, 1]
        frame = np.array([0.0, 0.0, *self.stage.image_size])
        whole = enough(covered(box, frame))
        with np.errstate(invalid="ignore"):
            whole[~(tall >= self._smallest_px)] = 0.0
        out = whole[place]
        first_s, last_s = self.stage.span_s
        out[(time_s < first_s) | (time_s > last_s)] = 0.0
        looks = np.flatnonzero(out.any(axis=1))
        low, high = self._at(time_s[looks])
        looks, low, high = (one[high > low] for one in (looks, low, high))
        owner, seen = expand(low, high - low)
        cover = self.stage.tracks.box_xyxy[self._seen[seen]]
        here = place[looks[owner]]
        lower = (cover[:, None, 3] - box[here, 3]) / (BEFORE_SIGMA * np.maximum(tall, 1))[here]
        share = covered(box[here], cover[:, None])
        hides = ndtr(lower) * _NONE_COVERED
        over = np.nonzero(share > 0)
        hides[over] = ndtr(lower[over]) * enough(share[over])
        if len(looks):
            first = np.cumsum(high - low) - (high - low)
            out[looks] *= np.multiply.reduceat(np.nan_to_num(1 - hides), first, axis=0)
        return out

    def _upright(self, xy_m: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 4"]:
        assert self.stage.camera is not None
        foot, head = upright_uv(self.stage.camera, xy_m)
        half = _WIDTH_SHARE / 2 * (foot[:, 1] - head[:, 1])
        x = (foot[:, 0] + head[:, 0]) / 2
        return np.column_stack([x - half, head[:, 1], x + half, foot[:, 1]])

    @cached_property
    def _seen(self) -> Int[np.ndarray, "n"]:
        """Rows that show a box, by time."""
        tracks = self.stage.tracks
        rows = np.flatnonzero(tracks.observed & all_finite(tracks.box_xyxy))
        order: np.ndarray = rows[np.argsort(tracks.time_s[rows], kind="stable")]
        return order

    def _at(
        self, time_s: Float[np.ndarray, " k"]
    ) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
        """From which to which of the rows that show a box, by time, belong to some moments."""
        times, reach = self._times, 0.501 * self.stage.step_s
        ends = time_s.min(initial=np.inf) - reach, time_s.max(initial=-np.inf) + reach
        begin, end = np.searchsorted(times, ends[0]), np.searchsorted(times, ends[1], side="right")
        near = times[begin:end]  # a day's do not fit the processor's memory
        low = np.searchsorted(near, time_s - reach)
        return begin + low, begin + np.searchsorted(near, time_s + reach, side="right")

    @cached_property
    def _times(self) -> Float[np.ndarray, "n"]:
        return self.stage.tracks.time_s[self._seen]

    @cached_property
    def _smallest_px(self) -> float:
        """Height from which people are looked for."""
        rows = self._seen[self.stage.tracks.class_name[self._seen] == "person"]
        box = self.stage.tracks.box_xyxy[rows]
        smallest = float(np.quantile(box[:, 3] - box[:, 1], _SMALL_QUANTILE))
        return min(smallest, _SMALL_SHARE * self.stage.image_size[1])


def enough(share: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """P(so large a share of somebody is enough to see, or to hide him)."""
    return ndtr((share - _SEEN_SHARE) / _SEEN_SIGMA)


_NONE_COVERED = float(enough(np.zeros(1))[0])


def _squares_m2(
    a: Float[np.ndarray, "m 2"], b: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "m n"]:
    """Squared distances."""
    x, y = (a[:, None, axis] - b[:, axis] for axis in (0, 1))
    return np.asarray(x * x + y * y)


@cache
def _ways() -> tuple[Float[np.ndarray, "p 2"], Int[np.ndarray, "s w"], Float[np.ndarray, "w"]]:
    """The places that ways lead to, metres from where they begin; the number of that which each way
    has reached after each second, and the share of people who take it.
    """
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    far_m = np.arange(_LOOKS + 1)[:, None] * np.array(_SPEEDS_MPS)
    reached_m = (far_m[:, :, None, None] * unit).reshape(-1, 2)
    fan = len(_SPEEDS_MPS) * _DIRECTIONS
    time_s = np.arange(1, _LOOKS + 1)[:, None]
    places, shares = [np.zeros((_LOOKS, 1), int)], [np.array([1 - sum(_WAIT_SHARES)])]
    for wait_s, share in zip(_WAITS_S, _WAIT_SHARES, strict=True):
        places.append(np.maximum(time_s - wait_s, 0) * fan + np.arange(fan))
        shares.append(np.full(fan, share / fan))
    return reached_m, np.hstack(places), np.concatenate(shares)
