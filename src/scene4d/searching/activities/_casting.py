"""Casts of an activity: moments at which all its roles are present and close together."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from scene4d.core.errors import InputError
from scene4d.searching.activities._terms import lag_of, value_of
from scene4d.searching.activities.definition import Activity, Term
from scene4d.searching.predicates._meeting import (
    BOUND_SIGMA,
    check_count,
    earlier,
    expand,
    meetings,
    runs,
)
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates.stage import Stage

View = tuple[str, float]
"""A role, and its time lag (s): how much earlier it is evaluated."""
_BATCH = 400_000
"""Moments of casts that are evaluated at once: one probability for all takes 3 MB."""


@dataclass(frozen=True, eq=False)
class Casts:
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

    def only(self, casts: Bool[np.ndarray, "d"]) -> "Casts":
        """A selection of the casts."""
        count = self.count[casts]
        keep = np.repeat(casts, self.count)
        rows = {view: row[keep] for view, row in self.rows.items()}
        return Casts(rows, self.tick[keep], np.cumsum(count) - count, self.tracks[casts])

    def batches(self) -> Iterator["Casts"]:
        """Whole casts, about :data:`_BATCH` moments at a time."""
        if len(self) == 0:
            return
        begin = runs(self.first // _BATCH)
        for low, high in zip(begin, np.append(begin[1:], len(self.first)), strict=True):
            stop = self.first[high] if high < len(self.first) else len(self)
            moments = slice(self.first[low], stop)
            rows = {view: row[moments] for view, row in self.rows.items()}
            first = self.first[low:high] - self.first[low]
            yield Casts(rows, self.tick[moments], first, self.tracks[low:high])


def views_of(term: Term) -> tuple[View, ...]:
    """The views of a term: the lag belongs to its last role."""
    return (*((role, 0.0) for role in term.roles[:-1]), (term.roles[-1], lag_of(term)))


def rows_of_roles(stage: Stage, activity: Activity) -> dict[str, np.ndarray]:
    """Rows of the tracks that may play each role; a track has the class of its first row."""
    kinds = stage.tracks.class_name[stage.first_row]
    return {
        role.name: np.flatnonzero(np.isin(kinds, role.classes)[stage.track_of_row] & stage.used)
        for role in activity.roles
    }


def unbound_roles(activity: Activity) -> list[str]:
    """Roles that are not bound to another by a predicate such as near: everybody may play them who
    is there at the same time.
    """
    bonds = _bonds(activity)
    bound = {role for pair in bonds for role, _ in pair}
    return [role.name for role in activity.roles if role.name not in bound]


def cast(stage: Stage, activity: Activity, rows: Mapping[str, np.ndarray]) -> Casts:
    """All casts of an activity whose members come close enough, with the relevant moments.

    ``rows`` are those of each role. Two roles are bound by the phases' terms that are improbable
    beyond some distance; roles that nothing binds only need to be there at the same time. Raises
    :class:`InputError` where a role is looked at at any time before and nothing says where, and
    where there would be more moments than can be judged.
    """
    views = list(dict.fromkeys(view for term in activity.terms for view in views_of(term)))
    base = next((view for view in views if view[1] == 0), None)
    if base is None:
        raise InputError(f"{activity.name}: every role has a time lag; at least one must have none")
    bonds = _bonds(activity)
    found: dict[View, np.ndarray] = {base: rows[base[0]]}
    while len(found) < len(views):
        known, new, bond = _next_link(activity.name, bonds, list(found), views)
        if bond is None:
            shift = round(known[1] / stage.step_s) - round(new[1] / stage.step_s)
            at = found[known]
            found[new] = stage.row_at(stage.track_of_row[at], stage.tick[at] + shift)
        else:
            found = _joined(stage, found, (known, new), bond, rows)
    return _ordered(stage, activity, found, base)


@dataclass(frozen=True)
class _Bond:
    """How far two views may be apart, and for how long nothing binds them (s)."""

    reach_m: float = np.inf
    free_s: float = 0.0


def _bonds(activity: Activity) -> dict[frozenset[View], _Bond]:
    """Pairs of views that come near each other in some phase.

    If several phases bind a pair, each with its own reach, the widest reach applies.
    """
    pairs = {frozenset(views_of(term)): None for term in activity.terms if _reach_m(term)}
    found = {}
    for pair in pairs:
        reaches, free_s = [], 0.0
        for phase in activity.phases:
            own = [_reach_m(t) for t in phase.terms if frozenset(views_of(t)) == pair]
            tight = min(filter(None, own), default=None)
            if tight is None:
                free_s += phase.max_s
            else:
                reaches.append(tight)
            free_s += phase.gap_s
        found[pair] = _Bond(max(reaches), free_s)
    return found


def _reach_m(term: Term) -> float | None:
    """Distance beyond which a term of two roles is always below 0.01; None if there is none.

    The positions' own errors are left to the search, which widens its boxes by them.
    """
    predicate = PREDICATES[term.predicate]
    if predicate.holds != ("beyond" if term.negated else "within"):
        return None
    tau_m, *sigma_m = (
        value_of(term, name) for name in ("tau_m", "sigma_m") if name in predicate.parameters
    )
    return max(predicate.outline_m + tau_m + BOUND_SIGMA * sum(sigma_m), 0.1)


def _next_link(
    name: str, bonds: Mapping[frozenset[View], _Bond], found: list[View], views: list[View]
) -> tuple[View, View, _Bond | None]:
    """A view that is found, one that is not, and their bond, the tightest that there is; without a
    bond the new view is the same role at another time.
    """
    links = [
        (bonds[pair], known, new)
        for pair in bonds
        for known in found
        for new in pair - set(found)
        if known in pair
    ]
    if links:
        bond, known, new = min(links, key=lambda link: link[0].reach_m)
        return known, new, bond
    new = next(view for view in views if view not in found)
    if np.isinf(new[1]):
        raise InputError(
            f"{name}: {new[0]!r} may be at any earlier time, and no predicate such as near "
            "limits its position"
        )
    same = next((view for view in found if view[0] == new[0]), None)
    if same is not None:
        return same, new, None
    return next(view for view in found if view[1] == 0), new, _Bond()


def _joined(
    stage: Stage,
    found: dict[View, np.ndarray],
    link: tuple[View, View],
    bond: _Bond,
    rows: Mapping[str, np.ndarray],
) -> dict[View, np.ndarray]:
    """The moments found so far, with the matching rows of the new view."""
    known, new = link
    # The one evaluated later comes first; only one of the two has a lag.
    late, early = (new, known) if known[1] > 0 else (known, new)
    pairs = _pairs(stage, rows[late[0]], rows[early[0]], early[1], bond)
    from_row, to_row = pairs[::-1] if known[1] > 0 else pairs
    if len(found) == 1:
        return {known: from_row, new: to_row}
    order = np.argsort(from_row, kind="stable")
    begin = np.searchsorted(from_row[order], found[known])
    count = np.searchsorted(from_row[order], found[known], side="right") - begin
    check_count(int(count.sum()), len(found) + 1)
    owner, at = expand(begin, count)
    joined = {view: row[owner] for view, row in found.items()}
    joined[new] = to_row[order[at]]
    return _consistent(stage, joined, new)


def _pairs(
    stage: Stage, a: Int[np.ndarray, "n"], b: Int[np.ndarray, "m"], lag_s: float, bond: _Bond
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    if np.isinf(lag_s):
        return earlier(stage, a, b, reach_m=bond.reach_m)
    margin = int(min(np.ceil(bond.free_s / stage.step_s), stage.ticks))
    lag = round(lag_s / stage.step_s)
    return meetings(stage, a, b, reach_m=bond.reach_m, margin=margin, lag=lag)


def _consistent(stage: Stage, joined: dict[View, np.ndarray], new: View) -> dict[View, np.ndarray]:
    """Require one track per role, and different tracks for two roles."""
    track = stage.track_of_row
    keep = np.ones(len(joined[new]), bool)
    for view, row in joined.items():
        if view != new:
            same = (track[row] == track[joined[new]]) & (row >= 0)
            keep &= same | (row < 0) if view[0] == new[0] else ~same
    return {view: row[keep] for view, row in joined.items()}


def _ordered(stage: Stage, activity: Activity, found: dict[View, np.ndarray], base: View) -> Casts:
    columns = []
    for role in activity.roles:
        of_role = [row for view, row in found.items() if view[0] == role.name]
        row = of_role[0]
        for other in of_role[1:]:
            row = np.where(row < 0, other, row)
        columns.append(np.where(row < 0, -1, stage.track_of_row[row]))
    tick = stage.tick[found[base]]
    keep = np.ones(len(tick), bool)
    if is_symmetric(activity):
        keep = columns[0] < columns[1]
    order = _order([*columns, tick])
    order = order[keep[order]]
    columns = [column[order] for column in columns]
    first = runs(*columns)
    who = np.column_stack([column[first] for column in columns])
    return Casts({view: row[order] for view, row in found.items()}, tick[order], first, who)


def _order(keys: list[np.ndarray]) -> Int[np.ndarray, "n"]:
    """The order by these keys; skips sorting if they are already sorted, as they mostly are."""
    ordered = np.zeros(max(len(keys[0]) - 1, 0), bool)
    equal = ~ordered
    for key in keys:
        ordered |= equal & (key[1:] > key[:-1])
        equal &= key[1:] == key[:-1]
    return np.arange(len(keys[0])) if (ordered | equal).all() else np.lexsort(keys[::-1])


def is_symmetric(activity: Activity) -> bool:
    """Whether swapping two roles leaves the activity unchanged."""
    if any(role.is_counted for role in activity.roles):
        return False
    if len(activity.roles) != 2 or set(activity.roles[0].classes) != set(activity.roles[1].classes):
        return False
    one, two = (role.name for role in activity.roles)
    swap = {one: two, two: one}

    def said(term: Term, names: Mapping[str, str]) -> tuple:
        roles = tuple(names.get(role, role) for role in term.roles)
        if PREDICATES[term.predicate].symmetric and not lag_of(term):
            roles = tuple(sorted(roles))
        return (term.predicate, roles, tuple(sorted(term.parameters.items())), term.negated)

    return all(
        {said(term, {}) for term in phase.terms} == {said(term, swap) for term in phase.terms}
        for phase in activity.phases
    )
