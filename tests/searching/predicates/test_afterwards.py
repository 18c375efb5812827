"""What followed an end: he came out, he would have been seen, the car drove off, the film ended."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from predicate_stages import STEP_S, Path, stage_of

from scene4d.core.camera import Camera
from scene4d.searching.predicates._afterwards import Afterwards, Ends
from scene4d.searching.predicates._riding import drives_ratio, riding
from scene4d.searching.predicates._visibility import _afterwards, appears_from, disappears_into

CAMERA = Camera.from_pose(
    image_size=(1280, 720), focal_px=900.0, tilt_rad=0.3, roll_rad=0.0, height_m=5.0
)
CAR_M = (0.0, 15.0)
LAST_S = 10.0
"""When the person is last seen, beside the car's far side: within its outline."""


def walk(xy_m, begin_s, end_s, velocity=(0.0, 0.0), name="person", size_m=(0.6, 1.75)) -> Path:
    """Somebody, or a car as a box of ``size_m`` (width, height) above its place, in the picture;
    it is at ``xy_m`` at its end.
    """
    time = np.arange(begin_s, end_s + STEP_S / 2, STEP_S)
    velocity = np.asarray(velocity, float)
    xy = np.asarray(xy_m, float) + (time - time[-1])[:, None] * velocity
    corners = [
        CAMERA.project(
            np.column_stack([xy + np.array([side * size_m[0] / 2, 0]), 0 * xy[:, 0] + z])
        )[0]
        for side in (-1, 1)
        for z in (0.0, size_m[1])
    ]
    box = np.hstack([np.min(corners, axis=0), np.max(corners, axis=0)])
    return Path(time, xy, np.tile(velocity, (len(time), 1)), name=name, box_xyxy=box)


def car(begin_s=0.0, end_s=60.0, **more) -> Path:
    return walk((CAR_M[0], CAR_M[1] - 1.0), begin_s, end_s, name="car", size_m=(4.5, 2.2), **more)


PERSON = walk((0.0, CAR_M[1] + 1.0), 4.0, LAST_S, velocity=(-0.5, 0.3))
CLOCK = walk((3.0, 28.0), 0.0, 60.0, size_m=(1.0, 1.0), name="bicycle")


def weighed(*paths: Path, last=True, everybody=True) -> tuple[float, float]:
    """L of the first path's end, and P(it is in the second)."""
    stage = stage_of(*paths, size=CAMERA.image_size, camera=CAMERA, everybody=everybody)
    a = stage.rows(np.flatnonzero(stage.tracks.track == 1))
    b = stage.rows(np.full(len(a), stage.first_row[1]))
    into = disappears_into if last else appears_from
    return float(_afterwards(stage, last).ratio(np.array([0]))[0]), float(into(a, b).max())


def test_behind_a_car_that_stays_little_is_known_and_once_it_is_gone_all_is():
    stays, parked = weighed(PERSON, car(), CLOCK)
    goes, gone = weighed(PERSON, car(end_s=14.0), CLOCK)
    # Lost for good one of five, whatever is seen; who stays behind the car is hidden by it.
    assert 0.2 <= goes < 0.23
    assert goes + 0.05 < stays < 0.6
    assert parked < gone


def test_without_anything_that_hides_the_one_who_walked_on_would_have_been_seen():
    """Who ends in plain view is himself one of those who are lost there."""
    assert weighed(PERSON, CLOCK)[0] == pytest.approx(2 / 6, abs=0.02)


@pytest.mark.parametrize("left_s", [0.0, 0.6])
def test_at_the_end_of_the_footage_nothing_is_known(left_s):
    until = LAST_S + left_s
    clock = walk((3.0, 28.0), 0.0, until, size_m=(1.0, 1.0), name="bicycle")
    assert weighed(PERSON, car(end_s=until), clock)[0] == pytest.approx(1.0)


def test_the_longer_he_is_not_seen_the_likelier_he_is_inside():
    found = []
    for until in (11.4, 12.4, 15.0, 25.0, 60.0):
        clock = walk((3.0, 28.0), 0.0, until, size_m=(1.0, 1.0), name="bicycle")
        found.append(weighed(PERSON, car(end_s=until), clock)[0])
    assert all(late < early for early, late in pairwise(found))


def test_who_comes_out_on_the_other_side_had_not_got_in():
    """Behind the car for three seconds, then on in his direction; elsewhere it is another."""
    ratio, inside = weighed(PERSON, car(), CLOCK)
    along = walk((-6.0, 16.0), 13.0, 16.0, velocity=(-1.2, 0.0))
    elsewhere = walk((9.0, 24.0), 10.4, 16.0)
    came, still = weighed(PERSON, car(), CLOCK, along)
    other, unmoved = weighed(PERSON, car(), CLOCK, elsewhere)
    assert came > ratio + 0.3
    assert still < inside - 0.1
    assert other == pytest.approx(ratio, abs=0.08)
    assert unmoved == pytest.approx(inside, abs=0.05)


def test_where_only_some_people_are_tracked_nobody_is_missed():
    assert weighed(PERSON, car(end_s=14.0), CLOCK, everybody=False)[0] == pytest.approx(1.0)
    along = walk((-6.0, 16.0), 13.0, 16.0, velocity=(-1.2, 0.0))
    assert weighed(PERSON, car(), CLOCK, along, everybody=False)[0] > 1.3


def test_a_tracker_that_loses_people_in_plain_view_proves_less_by_losing_one():
    lost = [walk((x, 22.0), 2.0, 8.0 + x / 4) for x in (4.0, 5.5, 7.0, -4.0, -5.5, -7.0)]
    careful, _ = weighed(PERSON, car(end_s=14.0), CLOCK)
    careless, _ = weighed(PERSON, car(end_s=14.0), CLOCK, *lost)
    assert careless > careful + 0.15


def test_time_reversed_it_is_said_of_who_comes_out():
    def mirrored(path: Path) -> Path:
        return replace(
            path,
            time_s=60.0 - path.time_s[::-1],
            xy_m=path.xy_m[::-1],
            box_xyxy=path.box_xyxy[::-1],
        )

    along = walk((-6.0, 16.0), 13.0, 16.0, velocity=(-1.2, 0.0))
    for paths in ((PERSON, car(end_s=14.0), CLOCK), (PERSON, car(), CLOCK, along)):
        there = weighed(*paths)
        back = weighed(*map(mirrored, paths), last=False)
        assert back[0] == pytest.approx(there[0], abs=1e-6)
        # A car that stays says less against getting in than against getting out.
        assert there[1] - 0.05 < back[1] < there[1] + 1e-4


def test_of_two_who_end_alike_the_one_who_bends_has_got_in():
    bends = PERSON.box_xyxy.copy()
    bends[-3:, 1] += 0.4 * (bends[-3:, 3] - bends[-3:, 1])
    upright = weighed(PERSON, car(), CLOCK)[1]
    bent = weighed(replace(PERSON, box_xyxy=bends), car(), CLOCK)[1]
    assert bent > upright + 0.2
    bus = replace(car(), name="bus")
    assert weighed(PERSON, bus, CLOCK)[1] > upright + 0.1
    assert weighed(replace(PERSON, box_xyxy=bends), bus, CLOCK)[1] < bent


def into_a_car_of(tall_m: float, box: np.ndarray, person_m: float = 1.75) -> float:
    """P(the person whose boxes are these is in it), where heights are known to 5 cm."""
    stage = stage_of(replace(PERSON, box_xyxy=box), car(), CLOCK, size=CAMERA.image_size)
    tracks = stage.tracks
    size = np.full((len(tracks), 3), np.nan)
    size[:, 2] = np.where(tracks.class_name == "person", person_m, tall_m)
    stage = replace(
        stage, tracks=replace(tracks, size_m=size, size_sigma_m=np.full_like(size, 0.05))
    )
    a = stage.rows(np.flatnonzero(tracks.track == 1))
    return float(disappears_into(a, stage.rows(np.full(len(a), stage.first_row[1]))).max())


def test_posture_counts_as_far_as_one_cannot_stand_in_the_vehicle():
    bends = PERSON.box_xyxy.copy()
    bends[-3:, 1] += 0.4 * (bends[-3:, 3] - bends[-3:, 1])
    heights = (1.5, 2.0, 2.35, 2.7, 3.1)
    bent = [into_a_car_of(tall, bends) for tall in heights]
    upright = [into_a_car_of(tall, PERSON.box_xyxy) for tall in heights]
    told = np.subtract(bent, upright)
    assert told[0] > 0.2
    assert (np.diff(told) <= 1e-9).all()
    # Half way where it is 0.6 m taller than he is, and nothing is told by a bus.
    assert 0.3 < (upright[2] - upright[0]) / (upright[-1] - upright[0]) < 0.95
    assert told[-1] == pytest.approx(0.0, abs=0.01)
    # A child stands where a man stoops.
    assert into_a_car_of(2.0, PERSON.box_xyxy, 1.2) > into_a_car_of(2.0, PERSON.box_xyxy) + 0.1


def test_a_place_is_unknown_where_the_end_has_none():
    stage = stage_of(PERSON, car(), CLOCK, size=CAMERA.image_size, camera=CAMERA)
    tracks = replace(stage.tracks, xy_m=np.full_like(stage.tracks.xy_m, np.nan))
    blind = replace(stage, tracks=tracks)
    none = Ends(np.array([], int), np.array([], int), np.array([]), np.array([]))
    ends = Ends(stage.last_row[:1], np.array([0]), np.zeros(1), np.ones(1))
    assert Afterwards(blind, ends, none, True).ratio(np.array([0, 1])).tolist() == [1.0, 1.0]


def test_who_is_seen_through_the_window_of_a_car_that_drives_is_inside():
    """Somebody who begins within the car's outline when it drives off: along with it, or left."""
    (rides, along), (stays, left) = (driven(rides) for rides in (True, False))
    assert rides > 0.9
    assert stays < 0.5
    assert along < left


def driven(rides: bool) -> tuple[float, float]:
    time = np.arange(0.0, 20.0 + STEP_S / 2, STEP_S)
    way = np.maximum(time - 11.0, 0.0)[:, None] * [1.5, 0.0]
    still = car(end_s=20.0)
    shift = np.zeros((len(time), 4))
    shift[:, [0, 2]] = way[:, :1] * 60.0
    drives = replace(still, xy_m=still.xy_m + way, box_xyxy=still.box_xyxy + shift)
    late = time >= 10.6
    x1, y1, _, _ = still.box_xyxy[0]
    head = np.array([x1 + 80.0, y1 + 10.0, x1 + 120.0, y1 + 50.0]) + shift[late] * rides
    xy = np.array([0.0, 16.0]) + way[late] * rides
    seen = Path(time[late], xy, np.zeros_like(xy), box_xyxy=head)
    stage = stage_of(PERSON, drives, seen, size=CAMERA.image_size, camera=CAMERA)
    found = riding(stage, np.array([2, 2, 2]), np.array([1, -1, 0]))
    assert found[1:].tolist() == [0.0, 0.0]
    return float(found[0]), float(_afterwards(stage, True).ratio(np.array([0]))[0])


@pytest.mark.parametrize(("last", "shares"), [(True, (0.17, 0.10)), (False, (0.33, 0.12))])
def test_a_car_that_drives_off_soon_after_or_came_just_before_speaks_for_it(last, shares):
    """Within 20 s, watched to the end of them; later it is none, and unwatched nothing is known."""
    sign = 1.0 if last else -1.0
    time = np.arange(0.0, 60.0 + STEP_S / 2, STEP_S)
    inside, outside = shares

    def ratio(from_s: float, at_s: float) -> float:
        way = np.maximum(sign * (time - (30.0 + sign * from_s)), 0.0)[:, None] * [3.0, 0.0]
        stage = stage_of(Path(time, way, np.zeros_like(way), name="car"))
        return float(drives_ratio(stage, np.array([0]), np.array([at_s]), last)[0])

    assert ratio(10.0, 30.0) == pytest.approx(inside / outside, rel=1e-3)
    assert ratio(40.0, 30.0) == pytest.approx((1 - inside) / (1 - outside), rel=1e-3)
    assert ratio(40.0, 30.0 + sign * 20.0) == pytest.approx(1.0, abs=1e-3)
