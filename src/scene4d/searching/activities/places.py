"""Zones and lines on the ground: which are usable, and which an activity asks for."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.terms import nearest, places_of
from scene4d.searching.predicates.registry import Predicate
from scene4d.searching.predicates.rows import Stage


def check_zone(name: str, corners: Float[np.ndarray, "m 2"]) -> None:
    """Raise :class:`InputError` unless the corners bound one area: a simple polygon.

    The last corner is joined to the first, and may repeat it. Every pair of edges is looked at.
    """
    if not np.isfinite(corners).all():
        raise InputError(f"zone {name!r}: a corner is not finite")
    if len(corners) > 1 and (corners[0] == corners[-1]).all():
        corners = corners[:-1]
    if len(corners) < 3:
        raise InputError(f"zone {name!r}: {len(corners)} corners, expected at least 3")
    twice = (corners == np.roll(corners, -1, axis=0)).all(axis=1)
    if twice.any():
        raise InputError(f"zone {name!r}: corner {int(twice.argmax()) + 1} is there twice")
    crossing = _crossing(corners)
    if crossing is not None:
        first, second = crossing
        raise InputError(
            f"zone {name!r} crosses itself: the edge from corner {first + 1} meets the edge from "
            f"corner {second + 1}; give the corners in their order around the zone"
        )
    x, y = (corners - corners.mean(axis=0)).T
    area = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    if not area > 0:
        raise InputError(f"zone {name!r}: its corners lie on one line")


def check_line(name: str, points: Float[np.ndarray, "m 2"]) -> None:
    """Raise :class:`InputError` unless there are two different finite points."""
    if len(points) < 2 or not np.isfinite(points).all():
        raise InputError(f"line {name!r}: expected two or more finite points")
    if (points == points[0]).all():
        raise InputError(f"line {name!r}: all its points are the same")


def check_places(stage: Stage, activity: Activity, predicates: Mapping[str, Predicate]) -> None:
    """Raise :class:`InputError` for places that the activity names and the stage lacks, or that
    are no zone or no line.
    """
    terms = [term for phase in activity.phases for term in phase.terms]
    for kind, there in (("zone", stage.zones), ("line", stage.lines)):
        for name in places_of(terms, kind, predicates):
            if name not in there:
                raise InputError(f"{activity.name}: no {kind} {name!r}{nearest(name, there)}")
            (check_zone if kind == "zone" else check_line)(name, there[name])


def _crossing(corners: Float[np.ndarray, "m 2"]) -> tuple[int, int] | None:
    """Two edges, not neighbours, that touch; or neighbours that fold back on one another."""
    m = len(corners)
    a, b = corners, np.roll(corners, -1, axis=0)
    fold = _turn(a, b, np.roll(b, -1, axis=0)) == 0
    back = ((b - a) * (np.roll(b, -1, axis=0) - b)).sum(axis=1) < 0
    if (fold & back).any():
        first = int((fold & back).argmax())
        return first, (first + 1) % m
    i, j = np.triu_indices(m, 2)
    apart = ~((i == 0) & (j == m - 1))
    i, j = i[apart], j[apart]
    touching = _touch(a[i], b[i], a[j], b[j])
    return (int(i[touching][0]), int(j[touching][0])) if touching.any() else None


def _touch(
    a: Float[np.ndarray, "n 2"],
    b: Float[np.ndarray, "n 2"],
    c: Float[np.ndarray, "n 2"],
    d: Float[np.ndarray, "n 2"],
) -> Bool[np.ndarray, "n"]:
    """Whether the segments ab and cd share a point: their ends lie on both sides of one another."""
    boxes = (
        np.maximum(np.minimum(a, b), np.minimum(c, d))
        <= np.minimum(np.maximum(a, b), np.maximum(c, d))
    ).all(axis=1)
    sides = (_turn(a, b, c) * _turn(a, b, d) <= 0) & (_turn(c, d, a) * _turn(c, d, b) <= 0)
    return boxes & sides


def _turn(
    a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"], c: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n"]:
    """Sign of the turn from ab to ac."""
    ab, ac = b - a, c - a
    return np.sign(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
