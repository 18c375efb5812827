"""Pairs of cameras around loops: which agree, which are thrown out, and chains from one camera to
another.
"""

from collections.abc import Sequence

import numpy as np

from scene4d.alignment._factor import Factor
from scene4d.alignment._pairs import Link

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
    pose, covariance = _pose_of(one.factor)
    other, beside = np.zeros(4), np.diag(_LOOP_FLOOR**2)
    for step, forward in chain:
        assert step.factor is not None
        value, spread = _pose_of(step.factor)
        if not forward:
            value, spread = _turned_back(value, spread)
        other, beside = _appended(other, beside, value, spread)
    apart = pose - other
    apart[2] = np.angle(np.exp(1j * apart[2]))
    q = float(apart @ np.linalg.solve(covariance + beside, apart))
    return q, (float(np.hypot(*apart[:2])), float(abs(apart[2])), float(abs(apart[3])))


def _pose_of(factor: Factor) -> tuple[np.ndarray, np.ndarray]:
    values, covariance = factor.alone()
    pose = values[:4].copy()
    pose[3] -= values[4] * factor.epoch_s
    slopes = np.zeros((4, len(values)))
    slopes[:, :4] = np.eye(4)
    slopes[3, 4] = -factor.epoch_s
    return pose, slopes @ covariance @ slopes.T


def _appended(
    pose: np.ndarray, spread: np.ndarray, step: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A pose, and one given in its frame, as one; the two err independently."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    moved = turn @ step
    by_pose = np.eye(4)
    by_pose[:2, 2] = -moved[1], moved[0]
    return pose + moved, by_pose @ spread @ by_pose.T + turn @ own @ turn.T


def _turned_back(pose: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first camera in the frame of the second."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    back = -np.eye(4)
    back[:2, :2] = -np.array([[c, s], [-s, c]])
    value = back @ pose
    slopes = back.copy()
    slopes[:2, 2] = value[1], -value[0]
    return value, slopes @ spread @ slopes.T


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
    poses = {}
    for camera in group:
        pose, spread = np.zeros(4), np.zeros((4, 4))
        for step, forward in _chain(group[0], camera, links) or []:
            assert step.factor is not None
            value, own = _pose_of(step.factor)
            if not forward:
                value, own = _turned_back(value, own)
            pose, spread = _appended(pose, spread, value, own)
        poses[camera] = pose
    return poses


def groups_of(count: int, links: Sequence[Link]) -> list[list[int]]:
    """Cameras that are joined, each group in order."""
    group = list(range(count))
    for one in links:
        old, new = group[one.a], group[one.b]
        group = [new if number == old else number for number in group]
    return [[c for c in range(count) if group[c] == number] for number in sorted(set(group))]
