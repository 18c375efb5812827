"""All cameras of a site at once: factors of pairs become one estimate of poses, clocks and errors.

The unknowns of a camera are its position, heading and offset in the site, the drift of its clock,
and the errors of its calibration (:func:`_paths.error_modes`) with their unit priors. The site's
frame is that of the first camera of a group; its metre is that of all cameras together, since
the height of each is an unknown with a prior and none is exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from scene4d.alignment._factor import POSE, Factor, drift_information, linearised
from scene4d.alignment._loops import chained, consistent, groups_of
from scene4d.alignment._pairs import Link
from scene4d.alignment._paths import MODES, View, covariance_root
from scene4d.core.body import HEIGHT_SIGMA_M, PERSON_HEIGHT_M
from scene4d.core.calibration import PARAMETERS
from scene4d.core.placement import PLACED, Drift, Placement

_STEPS = 12
_RELINEARISED = 2
"""Times that factors are linearised anew at the site's estimate; a third changed no digit."""
_DRIFT_STEPS = 4
"""Steps to the drifts: their prior lets go of large ones by and by."""
_DRIFT_SIGMAS = 4.0
"""A drift is stated if it is so many standard deviations from zero."""
_LEAST_DRIFT = 2e-5
"""Smaller drifts (rate) are left alone: 0.07 s in an hour."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the cameras are in the site, in their order.

    ``placements`` of cameras that no chain of pairs joins to the largest group are undetermined;
    those of clocks that certainly run at different rates have a drift. ``errors`` (k,) of each
    camera are its most probable calibration errors in standard deviations of its modes.
    ``rejected`` are pairs thrown out, with the reason. ``groups`` are the cameras that are joined
    to each other.
    """

    placements: tuple[Placement, ...]
    errors: tuple[Float[np.ndarray, "k"], ...]
    groups: tuple[tuple[int, ...], ...]
    used: tuple[Link, ...]
    rejected: tuple[tuple[Link, str], ...]
    covariance: Float[np.ndarray, "u u"] = field(repr=False)
    slots: dict[int, slice] = field(repr=False)


def solve(views: Sequence[View], links: Sequence[Link]) -> Solution:
    """The site of the largest group of cameras, in the frame of its first one."""
    used, rejected = consistent([one for one in links if one])
    groups = groups_of(len(views), used)
    chosen = max(groups, key=lambda group: (len(group), -group[0]))
    inside = [one for one in used if one.a in chosen]
    point, covariance, slots = _estimate(views, inside, chosen)
    for _ in range(_RELINEARISED if len(inside) > 1 else 0):
        inside = [_relinearised(views, one, point, slots) for one in inside]
        point, covariance, slots = _estimate(views, inside, chosen)
    placements, errors = [], []
    for camera, view in enumerate(views):
        if camera not in slots:
            placements.append(Placement.undetermined(_why(camera, views, links, groups)))
            errors.append(np.zeros(MODES))
            continue
        at = slots[camera]
        placements.append(_placement(view, point[at], covariance[at, at]))
        errors.append(point[at][POSE:])
    return Solution(
        tuple(placements),
        tuple(errors),
        tuple(map(tuple, groups)),
        tuple(inside),
        tuple(rejected),
        covariance,
        slots,
    )


def _relinearised(
    views: Sequence[View], one: Link, point: np.ndarray, slots: dict[int, slice]
) -> Link:
    """A pair's factor at the site's estimate: other cameras may have moved it some way."""
    before = one.factor
    assert before is not None
    values, _ = _relative(before, point[slots[one.a]], point[slots[one.b]])
    a, b, found = views[one.a], views[one.b], list(one.found)
    again = linearised(a, b, found, values, before.epoch_s, before.wander_m)
    return replace(one, factor=again)


def _why(
    camera: int, views: Sequence[View], links: Sequence[Link], groups: Sequence[Sequence[int]]
) -> str:
    """Why a camera has no place: the most frequent reason of its pairs, or that only others without
    a place are joined to it.
    """
    group = next(group for group in groups if camera in group)
    if len(group) > 1:
        names = ", ".join(views[k].name for k in group if k != camera)
        return f"only {names} saw the same people, and no camera of the site did"
    said = [one.reason for one in links if not one and camera in (one.a, one.b) and one.reason]
    return max(said, key=said.count) if said else "no other camera saw the same people for certain"


def _placement(view: View, values: np.ndarray, covariance: np.ndarray) -> Placement:
    """The map of the camera's ground: from the pose, and the scale that its errors amount to.

    The scale is the mean ratio of true to reported distance from the camera over its tracks. The
    offset is that in the middle of them, which is known best where the clock drifts.
    """
    slopes = placed_slopes(view)
    at = slopes @ values
    found = Placement.from_parameters(at, _symmetric(slopes @ covariance @ slopes.T))
    rate, variance = values[POSE - 1], covariance[POSE - 1, POSE - 1]
    if rate == 0.0:
        return found
    return replace(found, drift=Drift(float(rate), float(np.sqrt(variance)), _middle_s(view)))


def placed_slopes(view: View) -> Float[np.ndarray, "5 13"]:
    """Derivatives of a camera's placement by its unknowns."""
    weight = np.einsum("na,nak->k", view.xy_m, view.modes_m) / max((view.xy_m**2).sum(), 1e-9)
    slopes = np.zeros((len(PLACED), POSE + MODES))
    slopes[:3, :3] = np.eye(3)
    slopes[3, POSE:] = -weight
    slopes[4, 3], slopes[4, POSE - 1] = 1.0, _middle_s(view)
    return slopes


def _middle_s(view: View) -> float:
    return float(view.time_s.min() + view.time_s.max()) / 2


def _estimate(
    views: Sequence[View], links: Sequence[Link], group: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, dict[int, slice]]:
    """Most probable unknowns of a group and their covariance: Gauss-Newton over all factors."""
    slots, size = {}, 0
    for camera in group:
        slots[camera] = slice(size, size + POSE + MODES)
        size = slots[camera].stop
    point = np.zeros(size)
    for camera, pose in chained(links, group).items():
        point[slots[camera]][: POSE - 1] = pose
    drifting = _drifting(views, links, slots, point)
    information = np.zeros((size, size))
    for _ in range(_STEPS):
        information, force = _normal(views, links, slots, point, drifting)
        moved = np.linalg.solve(information, force)
        point = point + moved
        if np.abs(moved).max() < 1e-6:
            break
    covariance = np.linalg.inv(information)
    first = slots[group[0]]
    held = np.arange(first.start, first.start + POSE)
    covariance += _of_the_metre(views, links, slots, point, covariance)
    covariance[held] = covariance[:, held] = 0.0
    point[held] = 0.0
    for camera in group:
        if not drifting:
            at = slots[camera].start + POSE - 1
            covariance[at] = covariance[:, at] = point[at] = 0.0
    return point, covariance, slots


def _of_the_metre(
    views: Sequence[View],
    links: Sequence[Link],
    slots: dict[int, slice],
    point: np.ndarray,
    covariance: np.ndarray,
) -> Float[np.ndarray, "u u"]:
    """What it adds that all cameras have their metre from the same people.

    Their scales are taken to err independently; but the mean height of the population is one
    number for all, and so are the heights of people whom all saw. No camera ends up knowing its
    height worse than by itself: one that knows it well brings its own metre.
    """
    people = max(sum(len(one.pairs) for one in links), 1)
    variance = (_POPULATION_M**2 + HEIGHT_SIGMA_M**2 / people) / PERSON_HEIGHT_M**2
    grown = np.zeros(len(point))
    row = PARAMETERS.index("log_height")
    for camera, at in slots.items():
        root = covariance_root(views[camera].calibration)
        left = covariance[at, at][POSE : POSE + MODES - 1, POSE : POSE + MODES - 1]
        variance = min(variance, float(root[row] @ root[row] - root[row] @ left @ root[row]))
        here = grown[at]
        here[:2] = point[at][:2]
        here[POSE : POSE + MODES - 1] = -np.linalg.pinv(root)[:, row]
    return max(variance, 0.0) * np.outer(grown, grown)


_POPULATION_M = 0.03
"""Standard deviation (m) of a population's mean height: that of the options of calibrate."""
_HELD = 1e12
"""Information that holds an unknown at zero."""


def _drifting(
    views: Sequence[View], links: Sequence[Link], slots: dict[int, slice], point: np.ndarray
) -> bool:
    """Whether the clocks run at different rates for certain: else one rate is assumed."""
    here = point.copy()
    for _ in range(_DRIFT_STEPS):
        information, force = _normal(views, links, slots, here, True)
        here += np.linalg.solve(information, force)
    covariance = np.linalg.inv(information)
    for one in slots.values():
        at = one.start + POSE - 1
        if abs(here[at]) > max(_DRIFT_SIGMAS * np.sqrt(covariance[at, at]), _LEAST_DRIFT):
            return True
    return False


def _normal(
    views: Sequence[View],
    links: Sequence[Link],
    slots: dict[int, slice],
    point: np.ndarray,
    drifting: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Information of all unknowns at a point, and the force that moves them."""
    size = len(point)
    information, force = np.zeros((size, size)), np.zeros(size)
    for one in links:
        assert one.factor is not None
        values, slopes = _relative(one.factor, point[slots[one.a]], point[slots[one.b]])
        pull = one.factor.vector - one.factor.information @ _near(values, one.factor.at)
        columns = np.r_[slots[one.a], slots[one.b]]
        information[np.ix_(columns, columns)] += slopes.T @ one.factor.information @ slopes
        force[columns] += slopes.T @ pull
    prior = np.zeros(size)
    for number, camera in enumerate(slots):
        start = slots[camera].start
        prior[start + POSE : slots[camera].stop] = 1.0
        rate = float(point[start + POSE - 1])
        prior[start + POSE - 1] = drift_information(rate) if drifting else _HELD
        if number == 0:
            prior[start : start + POSE] = _HELD
    information[np.diag_indices(size)] += prior
    return information, force - prior * point


def _near(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values with the heading on the same turn as that of the linearisation."""
    near = values.copy()
    near[2] = at[2] + np.angle(np.exp(1j * (values[2] - at[2])))
    return near


def _relative(factor: Factor, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A factor's unknowns from those of its cameras in the site, and the derivatives.

    Drifts are small and only their difference counts; the offset holds at the factor's epoch.
    """
    c, s = np.cos(a[2]), np.sin(a[2])
    back = np.array([[c, s], [-s, c]])
    step = back @ (b[:2] - a[:2])
    ka = kb = MODES
    values = np.concatenate([step, [b[2] - a[2], 0.0, b[4] - a[4]], a[POSE:], b[POSE:]])
    epoch = factor.epoch_s + a[3]
    values[3] = b[3] - a[3] + (b[4] - a[4]) * epoch
    slopes = np.zeros((POSE + ka + kb, 2 * POSE + ka + kb))
    of_b = POSE + ka
    slopes[:2, :2], slopes[:2, of_b : of_b + 2] = -back, back
    slopes[:2, 2] = step[1], -step[0]
    for row in (2, 3, 4):
        slopes[row, row], slopes[row, of_b + row] = -1.0, 1.0
    slopes[3, 4], slopes[3, of_b + 4] = -epoch, epoch
    slopes[POSE : POSE + ka, POSE:of_b] = np.eye(ka)
    slopes[POSE + ka :, of_b + POSE :] = np.eye(kb)
    return values, slopes


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return (matrix + matrix.T) / 2
