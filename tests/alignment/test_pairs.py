"""Where a second camera lies to the first, from made sites with known truth; and refusals."""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from alignment.worlds import Walk, made_site, sampled
from scene4d.alignment._graph import solve
from scene4d.alignment._pairs import link
from scene4d.alignment._paths import view_of


def views(site):
    return [view_of(one.name, one.tracks, one.calibration) for one in site.seen]


@lru_cache
def linked(seed, **options):
    """A made site, its views and what the two say of each other; kept, for it takes time."""
    site = made_site(seed, **options)
    seen = views(site)
    return site, seen, link(*seen)


def errors(placement, truth):
    """Estimate less truth, and the same in standard deviations."""
    apart = placement.parameters - truth.parameters
    apart[2] = np.angle(np.exp(1j * apart[2]))
    return apart, apart / np.sqrt(np.diag(placement.covariance))


@pytest.mark.parametrize("seed", [3, 6])
def test_finds_place_and_clock_from_people_alone(seed):
    site, seen, found = linked(seed)
    assert found, found.reason
    placement = solve(seen, [found]).placements[1]
    apart, sigmas = errors(placement, site.seen[1].truth)
    assert abs(apart[4]) < 0.15
    assert abs(apart[2]) < np.radians(5)
    assert np.all(np.abs(sigmas) < 3.5)
    assert found.accident < 1e-3


def test_pairs_of_tracks_show_one_person():
    site, _, found = linked(6)
    person = [dict(zip(s.tracks.track.tolist(), s.who.tolist(), strict=True)) for s in site.seen]
    right = [person[0][a] == person[1][b] for a, b, _ in found.pairs]
    assert len(right) > 5
    assert np.mean(right) > 0.9


def test_the_other_way_round_is_the_inverse():
    _, (a, b), found = linked(6)
    there = solve([a, b], [found]).placements[1]
    back = solve([b, a], [link(b, a)]).placements[1]
    assert abs(there.time_offset_s + back.time_offset_s) < 0.05
    assert abs(np.angle(np.exp(1j * (there.heading_rad + back.heading_rad)))) < 0.01
    reach = [np.hypot(one.x_m, one.y_m) for one in (there, back)]
    assert reach[0] == pytest.approx(reach[1], rel=0.01)


def test_cameras_that_share_nobody_are_refused():
    site = made_site(2, overlap=-1.5, minutes=3.0)
    found = link(*views(site))
    assert not found
    assert "share nobody" in found.reason


def _alone(walks, **options):
    return link(*views(made_site(5, walks=walks, missed=0.0, false=0.0, minutes=1.0, **options)))


def test_one_who_stands_is_refused():
    standing = Walk(np.arange(0, 60, 0.2), np.tile([4.0, 0.5], (300, 1)))
    assert "nobody walks" in _alone([standing]).reason


def test_one_who_walks_steadily_along_a_line_is_refused():
    steady = sampled(np.array([0.0, 20.0]), np.array([[-9.0, 0.0], [17.0, 0.5]]))
    assert not _alone([steady])


def test_people_who_walk_one_way_leave_the_offset_open():
    """Found two seconds and three metres off before the offset was tried."""
    found = link(*views(made_site(7, overlap=0.0)))
    assert not found
    assert "time offset" in found.reason


def test_a_camera_that_was_turned_is_told_by_whom_the_other_still_sees_there():
    site, seen, found = linked(4, minutes=4.0)
    assert found and found.note is None
    rows, turn = site.seen[1].tracks, np.array([[0.88, -0.48], [0.48, 0.88]])
    late = (rows.time_s > np.mean(rows.time_s))[:, None]
    turned = replace(
        rows,
        xy_m=np.where(late, rows.xy_m @ turn.T, rows.xy_m),
        velocity_mps=np.where(late, rows.velocity_mps @ turn.T, rows.velocity_mps),
    )
    moved = link(seen[0], view_of("turned", turned, site.seen[1].calibration))
    assert moved and "one of the cameras moved" in moved.note
    when = float(re.search(r"(\d+) s of the first", moved.note)[1])
    assert when == pytest.approx(np.mean(rows.time_s) + moved.factor.at[3], abs=20.0)


def test_a_camera_without_tracks_is_named():
    site = made_site(3, walks=[Walk(np.arange(0, 9, 0.2), np.full((45, 2), 900.0))], false=0.0)
    assert "tracked nobody" in link(*views(site)).reason
