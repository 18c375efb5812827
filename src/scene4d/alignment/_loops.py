"""Pairs of cameras around loops: which agree, which are thrown out, and chains from one camera to
another.
"""

from collections.abc import Sequence

import numpy as np

from scene4d.alignment._factor import Factor
from scene4d.alignment._pairs import Link
from scene4d.core.placement import Placement

_LOOP_GATE = 23.5
"""99.99 % of chi-squared with four degrees of freedom: a loop further off holds a wrong pair."""
_LOOP_FLOOR = np.array([0.05, 0.05, 0.005, 0.03])
"""What a loop may err by beside what its pairs say (m, m, rad, s): linear errors of cameras."""


def consistent(links: Sequence[Link]) -> tuple[list[Link], list[tuple[Link, str]]]:
    """Pairs that agree around every loop, of as high a total score as can be had, and the others.

    The best pairs come first; each further one must fit what the cameras' chain of pairs already
    says. Then a pair is dropped if what contradicts it scores more together.
    """
    order = sorted(links, key=lambda one: -one.score)
    kept, out = _grown(order)
    for suspect in list(kept):
        others = [one for one in order if one is not suspect]
        again, left = _grown(others)
        if sum(one.score for one in again) > sum(one.score for one in kept) + 1e-9:
            kept, out = again, [*left, suspect]
    reasons = []
    for one in out:
        gap = _gap(one, kept)
        metres, turn, seconds = (0.0, 0.0, 0.0) if gap is None else gap[1]
        reasons.append(
            (
                one,
                "its place contradicts that from the other cameras "
                f"(by {metres:.1f} m, {np.degrees(turn):.0f}°, {seconds:.1f} s)",
            )
        )
    return kept, reasons


def _grown(order: Sequence[Link]) -> tuple[list[Link], list[Link]]:
    kept: list[Link] = []
    out: list[Link] = []
    for one in order:
        gap = _gap(one, kept)
        (kept if gap is None or gap[0] < _LOOP_GATE else out).append(one)
    return kept, out


def _gap(one: Link, kept: Sequence[Link]) -> tuple[float, tuple[float, float, float]] | None:
    """How far a pair is from what a chain of others says: chi-squared, and metres, radians and
    seconds; None without a chain.
    """
    chain = _chain(one.a, one.b, kept)
    if chain is None:
        return None
    assert one.factor is not None
    apart, other = _place_of(one.factor), _along(chain)
    step = (apart.parameters - other.parameters)[_POSE]
    step[2] = np.angle(np.exp(1j * step[2]))
    spread = (apart.covariance + other.covariance)[np.ix_(_POSE, _POSE)]
    q = float(step @ np.linalg.solve(spread + np.diag(_LOOP_FLOOR**2), step))
    return q, (float(np.hypot(*step[:2])), float(abs(step[2])), float(abs(step[3])))


_POSE = [0, 1, 2, 4]
"""A place without its scale."""


def _place_of(factor: Factor) -> Placement:
    values, covariance = factor.alone()
    slopes = np.zeros((5, len(values)))
    slopes[:3, :3] = np.eye(3)
    slopes[4, 3], slopes[4, 4] = 1.0, -factor.epoch_s
    return Placement.from_parameters(slopes @ values, slopes @ covariance @ slopes.T)


def _along(chain: Sequence[tuple[Link, bool]]) -> Placement:
    """Where the end of a chain lies from its beginning."""
    place = Placement.identity()
    for step, forward in chain:
        assert step.factor is not None
        found = _place_of(step.factor)
        place = (found if forward else found.inverse()).then(place)
    return place


def _chain(a: int, b: int, links: Sequence[Link]) -> list[tuple[Link, bool]] | None:
    """The shortest chain of pairs from camera a to camera b, each with whether it runs forward."""
    reached: dict[int, list[tuple[Link, bool]]] = {a: []}
    front = [a]
    while front and b not in reached:
        after = []
        for here in front:
            for one in links:
                for start, stop, forward in ((one.a, one.b, True), (one.b, one.a, False)):
                    if start == here and stop not in reached:
                        reached[stop] = [*reached[here], (one, forward)]
                        after.append(stop)
        front = after
    return reached.get(b)


def chained(links: Sequence[Link], group: Sequence[int]) -> dict[int, np.ndarray]:
    """First poses of a group's cameras (x, y, heading, offset) along chains of pairs."""
    chains = {camera: _chain(group[0], camera, links) or [] for camera in group}
    return {camera: _along(chain).parameters[_POSE] for camera, chain in chains.items()}


def groups_of(count: int, links: Sequence[Link]) -> list[list[int]]:
    """Cameras that are joined, each group in order."""
    group = list(range(count))
    for one in links:
        old, new = group[one.a], group[one.b]
        group = [new if number == old else number for number in group]
    return [[c for c in range(count) if group[c] == number] for number in sorted(set(group))]
