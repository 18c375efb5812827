"""Who could play an activity, and when: moments at which all its roles are there and close."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Activity, Role, Term
from scene4d.searching.activities.meeting import Clock, earlier, meetings
from scene4d.searching.activities.ragged import expand, runs
from scene4d.searching.activities.reach import is_symmetric, reach_of
from scene4d.searching.activities.terms import lag_of
from scene4d.searching.predicates.registry import Predicate

View = tuple[str, float]
"""A role, and how much earlier it is looked at (s)."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Moments of casts, ordered by (cast, moment).

    ``rows`` has the stage's row of every view, -1 where that track had none; ``tick`` the moment;
    ``first`` where each cast begins; ``tracks`` (casts, roles) who plays, as positions in the
    stage's tracks.
    """

    rows: Mapping[View, Int[np.ndarray, "n"]]
    tick: Int[np.ndarray, "n"]
    first: Int[np.ndarray, "d"]
    tracks: Int[np.ndarray, "d k"]

    def __len__(self) -> int:
        return len(self.tick)

    @property
    def count(self) -> Int[np.ndarray, "d"]:
        """Moments of each cast."""
        return np.diff(np.append(self.first, len(self.tick)))

    def only(self, casts: Bool[np.ndarray, "d"]) -> "Frames":
        """These casts."""
        count = self.count[casts]
        keep = np.repeat(casts, self.count)
        return Frames(
            {view: row[keep] for view, row in self.rows.items()},
            self.tick[keep],
            np.cumsum(count) - count,
            self.tracks[casts],
        )


def views_of(term: Term) -> tuple[View, ...]:
    """What a term looks at: the lag is that of its last role."""
    return (*((role, 0.0) for role in term.roles[:-1]), (term.roles[-1], lag_of(term)))


def cast(clock: Clock, activity: Activity, predicates: Mapping[str, Predicate]) -> Frames:
    """All casts of an activity that come close enough, with the moments that matter.

    Two roles are bound by the phases' terms that are improbable beyond some distance
    (:func:`reach_of`); roles that nothing binds only need to be there at the same time. Raises
    :class:`InputError` where a role is looked at at any time before, and nothing says where.
    """
    terms = [term for phase in activity.phases for term in phase.terms]
    views = list(dict.fromkeys(view for term in terms for view in views_of(term)))
    base = next((view for view in views if view[1] == 0), None)
    if base is None:
        raise InputError(f"{activity.name}: every role is looked at earlier, earlier than what?")
    rows = {role.name: _rows_of(clock, role) for role in activity.roles}
    found: dict[View, np.ndarray] = {base: rows[base[0]]}
    while len(found) < len(views):
        link = _next_link(activity, predicates, found, views)
        found = _joined(clock, found, link, rows)
    return _ordered(clock, activity, found, base)


@dataclass(frozen=True)
class _Link:
    """A view that is known, the one to be found from it, and how far they may be apart.

    ``known`` and ``new`` may come in any order in time: ``lag_s`` is how much earlier ``late``'s
    counterpart is. Without a reach, ``looked_up``, the new view is the known role at another time.
    """

    known: View
    new: View
    reach_m: float
    margin_s: float
    looked_up: bool = False


def _next_link(
    activity: Activity,
    predicates: Mapping[str, Predicate],
    found: Mapping[View, np.ndarray],
    views: list[View],
) -> _Link:
    """The tightest link to a view not yet found."""
    links = []
    for phase in activity.phases:
        for term in phase.terms:
            if len(term.roles) < 2:
                continue
            one, two = views_of(term)
            reach = reach_of(term, predicates)
            for known, new in ((one, two), (two, one)):
                if known in found and new not in found:
                    links.append(_Link(known, new, reach, 0.0))
    if links:
        best = min(links, key=lambda link: link.reach_m)
        if np.isfinite(best.reach_m):
            pair = {best.known, best.new}
            # Where every phase that binds the pair has its own reach, the widest one holds.
            reaches, free_s = [], 0.0
            for phase in activity.phases:
                binding = [
                    reach_of(term, predicates)
                    for term in phase.terms
                    if len(term.roles) == 2 and set(views_of(term)) == pair
                ]
                tight = min(binding, default=np.inf)
                if np.isfinite(tight):
                    reaches.append(tight)
                else:
                    free_s += phase.max_s
                free_s += phase.gap_s
            return replace(best, reach_m=max(reaches), margin_s=free_s)
    new = next(view for view in views if view not in found)
    same = next((view for view in found if view[0] == new[0]), None)
    if np.isinf(new[1]):
        raise InputError(
            f"{activity.name}: {new[0]!r} is looked at any time before, and no predicate such as "
            "near says where"
        )
    if same is not None:
        return _Link(same, new, np.inf, 0.0, looked_up=True)
    known = next(view for view in found if view[1] == 0)
    return _Link(known, new, np.inf, 0.0)


def _joined(
    clock: Clock,
    found: dict[View, np.ndarray],
    link: _Link,
    rows: Mapping[str, Int[np.ndarray, "n"]],
) -> dict[View, np.ndarray]:
    """The moments found so far, with the new view's rows beside them."""
    known, new = link.known, link.new
    if link.looked_up:
        step = clock.stage.step_s
        shift = round(known[1] / step) - round(new[1] / step)
        at = found[known]
        row = clock.row_at(clock.stage.track_of_row[at], clock.tick[at] + shift)
        return {**found, new: row}
    flipped = known[1] > 0
    late, early = (new, known) if flipped else (known, new)
    pairs = _pairs(clock, rows[late[0]], rows[early[0]], early[1], link)
    from_row, to_row = pairs[::-1] if flipped else pairs
    if len(found) == 1:
        return {known: from_row, new: to_row}
    order = np.argsort(from_row, kind="stable")
    begin = np.searchsorted(from_row[order], found[known])
    end = np.searchsorted(from_row[order], found[known], side="right")
    owner, at = expand(begin, end - begin)
    joined = {view: row[owner] for view, row in found.items()}
    joined[new] = to_row[order[at]]
    return _consistent(clock, joined, new)


def _pairs(
    clock: Clock, a: np.ndarray, b: np.ndarray, lag_s: float, link: _Link
) -> tuple[np.ndarray, np.ndarray]:
    if np.isinf(lag_s):
        return earlier(clock, a, b, reach_m=link.reach_m)
    step = clock.stage.step_s
    most = clock.span
    margin = int(min(np.ceil(link.margin_s / step), most)) if link.margin_s < np.inf else most
    return meetings(clock, a, b, reach_m=link.reach_m, margin=margin, lag=round(lag_s / step))


def _consistent(clock: Clock, joined: dict[View, np.ndarray], new: View) -> dict[View, np.ndarray]:
    """One role is one track, and two roles are two."""
    track = clock.stage.track_of_row
    keep = np.ones(len(joined[new]), bool)
    for view, row in joined.items():
        if view != new:
            same = (track[row] == track[joined[new]]) & (row >= 0)
            keep &= same | (row < 0) if view[0] == new[0] else ~same
    return {view: row[keep] for view, row in joined.items()}


def _ordered(clock: Clock, activity: Activity, found: dict[View, np.ndarray], base: View) -> Frames:
    track = clock.stage.track_of_row
    columns = []
    for role in activity.roles:
        of_role = [row for view, row in found.items() if view[0] == role.name]
        row = of_role[0]
        for other in of_role[1:]:
            row = np.where(row < 0, other, row)
        columns.append(np.where(row < 0, -1, track[row]))
    tick = clock.tick[found[base]]
    keep = np.ones(len(tick), bool)
    if is_symmetric(activity):
        keep = columns[0] < columns[1]
    order = _order([*columns, tick])
    order = order[keep[order]]
    columns = [column[order] for column in columns]
    first = runs(*columns)
    who = np.column_stack([column[first] for column in columns])
    return Frames({view: row[order] for view, row in found.items()}, tick[order], first, who)


def _order(keys: list[np.ndarray]) -> Int[np.ndarray, "n"]:
    """What sorts by these keys; nothing is sorted that is in order, as it mostly is."""
    ordered = np.zeros(max(len(keys[0]) - 1, 0), bool)
    equal = ~ordered
    for key in keys:
        ordered |= equal & (key[1:] > key[:-1])
        equal &= key[1:] == key[:-1]
    return np.arange(len(keys[0])) if (ordered | equal).all() else np.lexsort(keys[::-1])


def _rows_of(clock: Clock, role: Role) -> Int[np.ndarray, "n"]:
    """Rows of tracks of the role's classes; a track is what it is at its first row."""
    stage = clock.stage
    kinds = stage.tracks.class_name[stage.first_row]
    return np.flatnonzero(np.isin(kinds, role.classes)[stage.track_of_row] & clock.used)
