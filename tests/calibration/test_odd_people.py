"""People whom no camera over one flat ground sees: refused or warned of with the reason."""

from dataclasses import replace

import numpy as np
import pytest
from odd_people import (
    CAMERA,
    SIZE,
    contradicting,
    cut_outs,
    joined,
    one_person,
    one_spot,
    porch,
    screen,
    segments,
    standing,
    walkers,
    walks,
)
from scenes import correspondence_error, parameters_of

from scene4d.calibration import CalibrateOptions, solve_segments
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from strategies import people_scene

GUESS = Orientation(1200.0, 0.35, 0.0, 180.0, 0.12, 0.05)


def solved(people: Segments, **known: object):
    options = CalibrateOptions(**({"orientation": "people"} | known))  # type: ignore[arg-type]
    return solve_segments(people, SIZE, options)


@pytest.mark.parametrize("spread", [0.02, 0.2, 0.5])
def test_cut_outs_of_any_size_anywhere_are_refused(spread):
    """A lens or a guess gives them a camera, which says nothing true about people held out."""
    for seed, known in enumerate(({"lens": CAMERA.lens}, {"orientation": GUESS})):
        found = solved(cut_outs(30, seed, spread), **known)
        assert not found
        assert "follow no ground" in found.reason or "only 2" in found.reason


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_two_groups_side_by_side_are_refused_or_the_error_is_wide(seed):
    """A camera in between explains nearly all of them: what is seen does not contradict it."""
    found = solved(contradicting(40, seed, "sides"))
    assert not found or found.ground_error_m["median"] > 1.0


def test_two_groups_that_contradict_each_other_are_named():
    found = solved(contradicting(40, 2, "mixed"))
    assert not found
    assert "contradict the others and agree on another camera" in found.reason
    assert "needed: footage of one camera" in found.reason


def test_a_television_beside_as_many_people_is_refused_and_its_place_is_named():
    found = solved(screen(15, 1, real=20))
    assert not found
    assert "within columns 9" in found.reason


def test_few_real_people_beside_a_television_are_at_least_a_warning():
    found = solved(screen(20, 0, real=4))
    assert found
    assert any("agree on another camera" in said for said in found.warnings)


def test_people_who_all_keep_to_a_small_part_may_be_on_a_television():
    people = screen(20, 0)
    assert "small part of the picture, within columns 9" in solved(people).reason
    found = solved(people, lens=CAMERA.lens)
    assert not found or any("small part of the picture" in said for said in found.warnings)


def small(seed: int) -> Segments:
    ground = walks(30, seed)
    children = standing(CAMERA, ground[20:], seed, heights_m=1.1)
    return joined(standing(CAMERA, ground[:20], seed), children)


def on_a_platform(seed: int) -> Segments:
    ground = walks(30, seed)
    above = standing(CAMERA, ground[22:], seed, base_m=1.2)
    return joined(standing(CAMERA, ground[:22], seed), above)


def behind_cars(seed: int) -> Segments:
    rng = np.random.default_rng(seed)
    seen = people_scene(CAMERA, 180, rng, tracks=30)
    left = np.where(rng.random(30) < 0.3, rng.uniform(0.3, 0.85, 30), 1.0)[seen.track]
    foot = seen.head_uv + left[:, None] * (seen.foot_uv - seen.head_uv)
    return segments(foot, seen.head_uv, seen.track)


@pytest.mark.parametrize("scene", [small, on_a_platform, behind_cars])
def test_one_in_three_smaller_higher_or_half_hidden_is_no_other_camera(scene):
    for seed in range(2):
        found = solved(scene(seed))
        assert found, found.reason
        assert not any("another camera" in said for said in found.warnings)


@pytest.mark.parametrize("known", [{"lens": CAMERA.lens}, {"orientation": GUESS}, {}])
def test_a_thing_taken_for_a_person_in_one_spot_is_nobody(known):
    for tracks in (1, 3):
        found = solved(one_spot(1, tracks=tracks), **known)
        assert not found
        assert "all people stand in one spot" in found.reason


def test_one_person_in_one_spot_gives_the_height_where_the_rest_is_given():
    given = Orientation(CAMERA.focal_px, CAMERA.tilt_rad, CAMERA.roll_rad)
    spot = standing(CAMERA, np.random.default_rng(0).normal([0, 12], 0.1, (1, 30, 2)), 0)
    found = solved(spot, orientation=given)
    assert found, found.reason
    assert abs(found.camera.height_m - 6) < 3 * found.sigma["height_m"]


def test_one_person_who_walks_is_a_warning_and_the_camera_is_right():
    found = solved(one_person(1))
    assert found
    assert any("may be one person" in said for said in found.warnings)
    z = (parameters_of(found.camera) - parameters_of(CAMERA))[:4]
    assert (np.abs(z) < 3 * np.sqrt(np.diag(found.covariance))[:4]).all()


def test_four_sightings_on_a_porch_are_refused():
    assert not any(solved(porch(seed)) for seed in range(2))


@pytest.mark.parametrize("known", [{"lens": CAMERA.lens}, {"orientation": GUESS}, {}])
def test_ordinary_scenes_raise_no_doubt(known):
    for people in (4, 25):
        found = solved(walkers(people, people), **known)
        assert found, found.reason
        assert not any("another" in w or "small part" in w for w in found.warnings)


GROUND = walks(30, 1)
STAIRS = GROUND * [1, 0.35] + [0, 8]
UNSEEN = {
    "all sit": ({"heights_m": 1.25}, (2.0, 3.5)),
    "all lean by 8°": ({"lean": np.tan(np.radians(8))}, (0.7, 1.7)),
    "a slope away by 10°": (
        {"base_m": np.tan(np.radians(10)) * (GROUND[..., 1] - 10)},
        (1.2, 2.6),
    ),
    "stairs": ({"base_m": np.floor((STAIRS[..., 1] - 8) / 0.3) * 0.17}, (1.2, 3.5)),
    "a slope across by 8°": ({"base_m": np.tan(np.radians(8)) * GROUND[..., 0]}, (0.2, 0.9)),
}


@pytest.mark.parametrize(("scene", "error_m"), UNSEEN.values(), ids=UNSEEN.keys())
def test_what_feet_and_heads_cannot_tell_is_an_assumption(scene, error_m):
    """Nothing is wrong in the picture: docs/method.md and the report name it, with these errors."""
    places = STAIRS if error_m == UNSEEN["stairs"][1] else GROUND
    found = solved(standing(CAMERA, places, 1, **scene))
    assert found
    apart = correspondence_error(CAMERA, found.camera, places.reshape(-1, 2))
    assert error_m[0] < np.median(apart) < error_m[1]


def test_a_mirrored_picture_has_a_mirrored_camera():
    people = walkers(25, 3)
    mirror = np.array([SIZE[0] - 1, 0]), np.array([-1, 1])
    ends = [mirror[0] + mirror[1] * uv for uv in (people.foot_uv, people.head_uv)]
    found, mirrored = solved(people), solved(replace(people, foot_uv=ends[0], head_uv=ends[1]))
    assert mirrored.camera.roll_rad == pytest.approx(-found.camera.roll_rad, abs=1e-3)
    assert mirrored.camera.focal_px == pytest.approx(found.camera.focal_px, rel=1e-2)
    assert mirrored.warnings == found.warnings
