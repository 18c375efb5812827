"""All predicates by name: what they promise, whatever the rows."""

import inspect
from dataclasses import fields, replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import Path, rows_of, stage_of, with_spots

from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.store.schema import GROUPS

NAMES = {
    "near", "far", "moving", "stationary", "moving_towards", "moving_away", "following",
    "turning_left", "turning_right", "speed_above", "speed_below", "reversing", "appears",
    "disappears", "inside", "crosses", "facing", "arm_moving_down", "arm_moving_up", "same_place",
    "u_turning", "appears_from", "disappears_into", "stooping", "crowded",
    "together", "between", "alone", "staying",
    "longer_than", "taller_than", "at_entrance", "beside",
    "arrived", "departs", "near_spot", "near_zone", "present", "coloured",
}  # fmt: skip
UNITS = {"m", "s", "m/s", "rad", "", "zone", "line", "spot", "side", "colour", "part"}
GIVEN = {"zone": "yard", "line": "gate", "spot": "was", "colour": "dark blue"}
CAMERA = Camera.from_pose(
    image_size=(1280, 720), focal_px=900.0, tilt_rad=0.4, roll_rad=0.02, height_m=6.0
)
SQUARE = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]])


def test_these_are_all():
    assert set(PREDICATES) == NAMES


@pytest.mark.parametrize("name", sorted(NAMES))
def test_parameters_are_those_of_the_function(name):
    predicate = PREDICATES[name]
    assert predicate.name == predicate.function.__name__ == name
    signature = inspect.signature(predicate.function).parameters
    roles = [p for p in signature.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
    assert predicate.arity == len(roles) in (1, 2, 3)
    assert set(predicate.parameters) == set(signature) - {p.name for p in roles}
    for key, parameter in predicate.parameters.items():
        assert parameter.name == key
        assert parameter.unit in UNITS
        assert parameter.required == (signature[key].default is inspect.Parameter.empty)
        if isinstance(parameter.default, float):
            assert parameter.low <= parameter.default <= parameter.high
        else:
            assert parameter.unit in UNITS - {"m", "s", "m/s", "rad", ""}
    assert predicate.function.__doc__
    assert "P(" in predicate.function.__doc__


@st.composite
def paths(draw, tracks=3):
    """Tracks of any motion and knowledge: rows without position, box, keypoints, heading."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([0.0, 1.0, 30.0]))
    made = []
    for _ in range(tracks):
        n = draw(st.integers(1, 8))
        xy, velocity = spread * rng.normal(size=(n, 2)), spread * rng.normal(size=(n, 2))
        corner = rng.uniform(-50, 1200, (n, 2))
        box = np.concatenate([corner, corner + rng.uniform(0, 200, (n, 2))], axis=1)
        joints = rng.uniform(0, 700, (n, 26, 2))
        for values in (xy, velocity, box, joints):
            values[rng.random(n) < 0.2] = np.nan
        made.append(
            Path(
                np.cumsum(rng.uniform(0.05, 1.0, n)),
                xy,
                velocity,
                heading_rad=np.where(rng.random(n) < 0.3, np.nan, rng.uniform(-4, 4, n)),
                heading_sigma_rad=draw(st.sampled_from([0.0, 0.3, 9.0, np.nan])),
                box_xyxy=box,
                keypoint_uv=joints,
                sigma_m=draw(st.sampled_from([0.0, 0.3, 100.0])),
                sigma_mps=draw(st.sampled_from([0.0, 0.3, 100.0])),
            )
        )
    return made


@settings(max_examples=25)
@given(paths(), st.data())
def test_every_predicate_is_a_probability_or_unknown_of_its_own_row(some, data):
    places = data.draw(st.sampled_from(["zones", "lines"]))
    stage = stage_of(*some, **{places: {"yard" if places == "zones" else "gate": SQUARE}})
    stage = replace(stage, camera=data.draw(st.sampled_from([None, CAMERA])))
    stage = with_spots(stage, "was", np.random.default_rng(len(stage.tracks)))
    n = len(stage.tracks)
    index = st.lists(st.integers(0, n - 1), max_size=10)
    first = np.array(data.draw(index), int)
    second = np.array(data.draw(st.permutations(range(n))), int)[np.arange(len(first)) % n]
    third = second[::-1]
    order = np.array(data.draw(st.permutations(range(len(first)))), int)
    for predicate in PREDICATES.values():
        units = {p.unit: key for key, p in predicate.parameters.items()}
        if units.keys() & {"zone", "line"} - {places[:-1]}:
            continue
        more = {units[u]: GIVEN[u] for u in units.keys() & GIVEN.keys()}
        roles = [first, second, third][: predicate.arity]
        found = predicate.function(*(stage.rows(r) for r in roles), **more)
        assert found.shape == first.shape
        known = found[~np.isnan(found)]
        assert ((known >= 0) & (known <= 1)).all(), predicate.name
        # Rows do not know of one another: in another order the same values.
        again = predicate.function(*(stage.rows(r[order]) for r in roles), **more)
        np.testing.assert_allclose(again, found[order], atol=1e-12, err_msg=predicate.name)


class _Watched(Tracks):
    """Tracks that note of which groups of columns somebody asked, once they are ``watched``."""

    asked: ClassVar[set[str] | None] = None

    def __getattribute__(self, name):
        asked, group = type(self).asked, name.split("_")[0]
        if asked is not None and group in GROUPS:
            asked.add(group)
        return super().__getattribute__(name)


@pytest.mark.parametrize("name", sorted(NAMES))
def test_a_predicate_says_which_columns_it_looks_at(name, monkeypatch):
    """A search reads no others: what they say would be unknown for ever."""
    n = 6
    path = Path(
        np.arange(n) * 0.2,
        np.ones((n, 2)),
        np.ones((n, 2)),
        heading_rad=np.zeros(n),
        box_xyxy=np.tile([10.0, 10.0, 40.0, 90.0], (n, 1)),
        keypoint_uv=np.full((n, 26, 2), 20.0),
    )
    world = stage_of(path, path, zones={"yard": SQUARE}, lines={"gate": SQUARE})
    world = replace(with_spots(world, "was", np.random.default_rng(0)), camera=CAMERA)
    columns = {f.name: getattr(world.tracks, f.name) for f in fields(world.tracks)}
    world = replace(world, tracks=_Watched(**columns))
    monkeypatch.setattr(_Watched, "asked", set())
    predicate = PREDICATES[name]
    needed = {key: GIVEN[p.unit] for key, p in predicate.parameters.items() if p.required}
    roles = [rows_of(world, track) for track in (1, 2, 1)][: predicate.arity]
    predicate.function(*roles, **needed)
    if name == "facing":  # a side depends on the size, a glance does not
        predicate.function(*roles, side="front")
    assert predicate.reads == _Watched.asked


def test_of_no_rows_come_no_values():
    stage = stage_of(*[Path(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2)))] * 2)
    nothing = stage.rows(np.array([], int))
    for name in NAMES - {"inside", "near_zone", "crosses", "near_spot", "coloured"}:
        predicate = PREDICATES[name]
        assert predicate.function(*[nothing] * predicate.arity).shape == (0,)
    for empty in (stage_of(), replace(stage_of(), camera=CAMERA)):
        for name in NAMES - {"inside", "near_zone", "crosses", "near_spot", "coloured"}:
            predicate = PREDICATES[name]
            roles = [empty.rows(np.array([], int))] * predicate.arity
            assert predicate.function(*roles).shape == (0,)


def test_rows_of_the_registry_can_be_read_off_a_stage():
    stage = stage_of(Path(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2))))
    assert PREDICATES["stationary"].function(rows_of(stage, 1))[0] > 0.95
