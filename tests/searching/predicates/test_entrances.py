"""Ways in and out, by their use: a door among people who pass."""

from dataclasses import replace

import numpy as np
from predicate_stages import Path, rows_of, stage_of, straight

from scene4d.searching.predicates._entrances import at_entrance

MIDDLE = (600.0, 300.0, 640.0, 400.0)
DOOR, OPEN = (0.0, 0.0), (6.0, 0.0)
CLOCK = straight(
    (50.0, 50.0), (0.0, 0.0), 100.0, box_xyxy=np.tile((10.0, 10.0, 30.0, 60.0), (501, 1))
)
"""Somebody far off who is there all the time: when the clip begins and ends."""


def walker(start, end, begin_s, box=MIDDLE, **more) -> Path:
    path = straight(start, (np.array(end) - start) / 4.0, 4.0, begin_s, **more)
    return replace(path, box_xyxy=np.tile(box, (len(path), 1)))


def users(box=MIDDLE, **more) -> list[Path]:
    """Four go in at the door and four come out, from and to places far from one another; eight pass
    a place in the open.
    """
    far = [(8.0 * np.cos(angle), 8.0 * np.sin(angle)) for angle in np.arange(1.0, 9.0) / 3]
    ways = [(DOOR, one) if k % 2 else (one, DOOR) for k, one in enumerate(far)]
    by = [((6.0, -4.0 - k), (6.0, 4.0 + k)) for k in range(8)]
    return [walker(*way, 2.0 + 5 * k, box, **more) for k, way in enumerate([*ways, *by])]


def at(place, *paths, **more) -> float:
    stage = stage_of(*paths, walker(place, place, 85.0, **more), CLOCK)
    return float(at_entrance(rows_of(stage, len(paths) + 1))[0])


def test_a_door_is_where_those_who_come_begin_or_end():
    # Eight of eight at the door, and none of eight who pass; half of one in five is added.
    assert np.isclose(at(DOOR, *users()), 8.5 / 13, atol=0.01)
    assert np.isclose(at(OPEN, *users()), 0.5 / 13, atol=0.01)
    assert np.isclose(at((-20.0, 0.0), *users()), 0.1)


def test_ones_own_end_is_no_use_of_a_door():
    assert np.isclose(at(DOOR), 0.1)
    stage = stage_of(walker((-5.0, 0.0), DOOR, 5.0), CLOCK)
    np.testing.assert_allclose(at_entrance(rows_of(stage, 1)), 0.1)


def test_who_leaves_the_picture_there_uses_no_door():
    assert at(DOOR, *users(box=(0.0, 300.0, 40.0, 400.0))) < 0.06


def test_a_place_is_as_wide_as_it_is_known():
    beside = (0.0, -1.5)
    assert at(beside, *users()) < 0.15
    assert at(beside, *users(), sigma_m=2.0) > 0.5


def test_without_a_position_it_cannot_be_judged():
    path = walker(DOOR, DOOR, 5.0)
    lost = replace(path, xy_m=np.full_like(path.xy_m, np.nan))
    stage = stage_of(lost, CLOCK)
    assert np.isnan(at_entrance(rows_of(stage, 1))).all()
    assert len(at_entrance(stage_of().rows(np.zeros(0, int)))) == 0
