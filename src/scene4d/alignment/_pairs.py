"""Two cameras: where one lies to the other by the people both saw, or why that is not told."""

from dataclasses import dataclass

import numpy as np

from scene4d.alignment._factor import Factor, Match, factor_of, matches
from scene4d.alignment._hypotheses import hypotheses
from scene4d.alignment._options import MAX_OFFSET_S
from scene4d.alignment._paths import STEP_S, Paths, View
from scene4d.alignment._score import (
    APART_S,
    Crowd,
    Fit,
    Matching,
    Meetings,
    different,
    fitted,
    later,
)

_COMPARED, _FITTED = 24, 6
"""Candidates of the vote that are compared, and of them those that are moved to their best; more
found nothing new on made worlds."""
_SCANNED = 3_000
"""Moments by which candidates are compared before that."""
_LEAST_SCORE = 10.0
"""Least log-ratio of an alignment: e^10 against the thousands of places that were tried."""
_ACCIDENT = 1e-3
"""An alignment that accident reaches with a larger probability is refused."""
_MARGIN = 5.0
"""Log-ratio by which an alignment must beat its rivals."""
_TAIL = 2.0
"""Least scale of the tail of accidental scores. Made sites without anybody in common: the best
score less that of the mirror image had a scale of 1.4 (benchmarks.sites)."""
_EXTREMES = 5
"""Accidental scores that tell that scale."""
_ROUGH = 4.0
"""Variance with which candidates are compared before they are moved, over that of good fits."""
_HALF = 0.5
"""Share of that by which candidates differ before they are moved."""
_LATER_S = (-3.0, -1.5, 1.5, 3.0)
"""Changes of the offset (s) that an alignment must not survive."""
_ELSEWHEN_S = 5.0
"""Candidates at an offset so far from the best one's are accidents."""
_MOST_SIGMA_M, _MOST_SIGMA_RAD, _MOST_SIGMA_S = 1.0, np.radians(12.0), 1.0
"""What must be determined where the people are: position, heading, offset."""


@dataclass(frozen=True, eq=False)
class Link:
    """What two cameras, by their numbers, say of each other.

    False if undetermined, with the ``reason``. ``score`` is the log-ratio of the alignment against
    accident, ``accident`` the probability that accident reaches it. ``pairs`` are the numbers of
    tracks (a, b) that show one person, with the log-ratio of each. ``note`` says what is to be
    minded though they are aligned.
    """

    a: int
    b: int
    factor: Factor | None = None
    reason: str | None = None
    score: float = 0.0
    accident: float = 1.0
    pairs: tuple[tuple[int, int, float], ...] = ()
    found: tuple[Match, ...] = ()
    note: str | None = None

    def __bool__(self) -> bool:
        return self.factor is not None


def link(
    a: View,
    b: View,
    numbers: tuple[int, int] = (0, 1),
    offsets_s: tuple[float, float] = (-MAX_OFFSET_S, MAX_OFFSET_S),
) -> Link:
    """Where camera b lies to camera a. ``offsets_s`` bounds what is added to b's clock."""
    for view in (a, b):
        if not len(view.paths):
            return Link(*numbers, reason=f"camera {view.name} tracked nobody")
    crowds = Crowd.of(a.paths), Crowd.of(b.paths)
    real = _candidates(a.paths, b.paths, crowds, offsets_s)
    if not real:
        return Link(*numbers, reason="nobody walks a way that both cameras could have seen")
    meetings, best = Meetings(*crowds), real[0]
    if meetings.matching(best).score < _LEAST_SCORE:
        return Link(*numbers, reason=_NOBODY, score=best.score)
    mirror = b.paths.mirrored()
    decoys = _candidates(a.paths, mirror, (crowds[0], Crowd.of(mirror)), offsets_s)
    chance = _accident(best, real, decoys)
    best = fitted(meetings, best, (1.0, 1.0))
    matching = meetings.matching(best)
    refused = _refusal(best, real, chance, b.paths) if matching.pairs else _NOBODY
    if refused is None and any(
        later(meetings, best, seconds).score > best.score - _MARGIN for seconds in _LATER_S
    ):
        refused = _FREE_OFFSET
    if refused is not None:
        return Link(*numbers, reason=refused, score=best.score, accident=chance)
    found = matches(meetings, matching)
    factor = factor_of(a, b, found, best)
    refused = _untold(factor, found)
    if refused is not None:
        return Link(*numbers, reason=refused, score=best.score, accident=chance)
    first = np.unique(matching.pair, return_index=True)[1]
    track_a = crowds[0].paths.track[matching.row_a[first]]
    track_b = crowds[1].paths.track[matching.row_b[first]]
    pairs = zip(track_a.tolist(), track_b.tolist(), matching.gain.tolist(), strict=True)
    note = _moved(meetings, best, matching)
    return Link(*numbers, factor, None, best.score, chance, tuple(pairs), tuple(found), note)


_NOBODY = (
    "the tracks fit together no better than those of different people; "
    "the cameras share nobody at one time, or too few"
)
_LEAST_TRACKS, _LEAST_SHARE = 8, 0.2
"""Tracks that each part of the footage must have to be held against the other, and the share of the
other part's matches below which it has too few. Chosen: of 48 made pairs
that stay none fell below 0.43; where one is turned by 30 degrees halfway it is 0.1."""


def _moved(meetings: Meetings, best: Fit, matching: Matching) -> str | None:
    """A word where people who should be seen by both are so only before, or only after a moment."""
    rows, both = meetings.seen_by_both(best, matching)
    paths = meetings.a.paths
    worst, when = _LEAST_SHARE, 0.0
    for cut in np.linspace(0.1, 0.9, 17):
        k = int(cut * len(rows))
        shares = both[:k].mean() if k else 1.0, both[k:].mean() if k < len(rows) else 1.0
        fewest = min(len(np.unique(paths.track[part])) for part in (rows[:k], rows[k:]))
        if fewest >= _LEAST_TRACKS and min(shares) < worst * max(shares):
            worst, when = min(shares) / max(shares), float(paths.tick[rows[k]] * STEP_S)
            later = shares[1] < shares[0]
    if when == 0.0:
        return None
    return (
        f"{'after' if later else 'before'} {when:.0f} s of the first one's clock hardly anybody is "
        "where the other one sees him: one of the cameras moved, or its clock jumped; track the "
        "parts by themselves"
    )


_FREE_OFFSET = (
    "the time offset is not determined: who both cameras saw walked steadily one way, "
    "and a shift along it fits as well"
)


def _candidates(
    a: Paths, b: Paths, crowds: tuple[Crowd, Crowd], offsets_s: tuple[float, float]
) -> list[Fit]:
    """Different alignments with their scores, best first."""
    ballot = hypotheses(a, b, offsets_s)
    meetings = Meetings(*crowds, most=_SCANNED)
    voted = []
    for k in range(len(ballot)):
        values = [*ballot.shift_m[k], ballot.heading_rad[k], 0.0, ballot.offset_s[k]]
        voted.append(Fit(np.array(values, float), float(ballot.votes[k])))
    starts = [
        Fit(one.parameters, meetings.matching(one, _ROUGH).score)
        for one in different(voted, b.xy_m, _HALF)[:_COMPARED]
    ]
    starts = different(starts, b.xy_m)[:_FITTED]
    return different([fitted(meetings, start) for start in starts], b.xy_m)


def _accident(best: Fit, real: list[Fit], decoys: list[Fit]) -> float:
    """Probability that accident alone scores as high.

    What fits the mirror image, or the wrong time, fits by accident; there is always a place where
    nobody meets, which scores 0. The best of many accidents has a Gumbel distribution, whose scale
    is the mean excess of the few best over the next.
    """
    offset = best.parameters[4]
    wrong = [fit.score for fit in decoys]
    wrong += [f.score for f in real[1:] if abs(f.parameters[4] - offset) > _ELSEWHEN_S]
    scores = np.sort(np.maximum([*wrong, 0.0], 0.0))[::-1][: _EXTREMES + 1]
    scale = max(_TAIL, float(scores.mean() - scores[-1]))
    return float(-np.expm1(-np.exp(-(best.score - scores[0]) / scale)))


def _refusal(best: Fit, real: list[Fit], chance: float, b: Paths) -> str | None:
    """Why the best alignment is not to be believed, if so."""
    if best.score < _LEAST_SCORE:
        return _NOBODY
    near = [fit for fit in real[1:] if fit.score > best.score - _MARGIN]
    rivals = [fit for fit in near if len(different([fit, best], b.xy_m)) > 1]
    if rivals:
        return _in_words(best, rivals[0])
    return _NOBODY if chance > _ACCIDENT else None


def _in_words(best: Fit, rival: Fit) -> str:
    turn = np.degrees(np.angle(np.exp(1j * (rival.parameters[2] - best.parameters[2]))))
    later = rival.parameters[4] - best.parameters[4]
    if abs(turn) > 30.0:
        how = f"turned by {abs(turn):.0f}°"
    elif abs(later) > APART_S:
        how = f"with the clocks {abs(later):.1f} s apart from that"
    else:
        how = "shifted along the way that people walk"
    return f"the tracks fit as well {how}: who both cameras saw moved too much alike"


def _untold(factor: Factor, found: list[Match]) -> str | None:
    """What the people in common leave open, the cameras taken as exact."""
    pose = factor.information[:4, :4] + np.diag([1e-4, 1e-4, 1e-2, 1e-6])
    covariance = np.linalg.inv(pose)
    middle = np.concatenate([match.xy_a for match in found]).mean(axis=0)
    lever = middle - factor.at[:2]
    at_people = np.zeros((2, 4))
    at_people[:, :2] = np.eye(2)
    at_people[:, 2] = -lever[1], lever[0]
    spread = np.sqrt(np.linalg.eigvalsh(at_people @ covariance @ at_people.T)[-1])
    sigma = np.sqrt(np.diag(covariance))
    if sigma[3] > _MOST_SIGMA_S:
        return (
            f"the time offset is not determined (±{sigma[3]:.1f} s): "
            "who both cameras saw walked steadily along one line, or stood"
        )
    if sigma[2] > _MOST_SIGMA_RAD:
        return (
            f"the heading is not determined (±{np.degrees(sigma[2]):.0f}°): "
            "who both cameras saw hardly moved"
        )
    if spread > _MOST_SIGMA_M:
        return f"the position is not determined (±{spread:.1f} m) by the people in common"
    return None
