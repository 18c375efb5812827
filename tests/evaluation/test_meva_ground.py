"""The local ground in front of a camera whose published pose is that of a whole site."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.strategies import build_camera, build_lens

from bodies import crowd, with_boxes
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.evaluation.datasets import _meva as meva
from scene4d.evaluation.datasets._meva import EVERY, Ground, local_ground

SIZE = (1920, 1080)
PEOPLE, SIGHTINGS = 40, 4


def camera(tilt_deg=22.0, roll_deg=1.0, height_m=7.0, bend=-0.05) -> Camera:
    """Over the plane on which the people stand."""
    lens = build_lens(SIZE, 60.0, radial=(bend, 0.0, 0.0))
    return build_camera(lens, tilt_deg, roll_deg, height_m)


def clip(truth: Camera, seed: int = 0, people: int = PEOPLE, frame: int = 0) -> Detections:
    """Boxes of so many people, 1.70 ± 0.09 m tall, each seen a few times a second apart."""
    rng = np.random.default_rng(seed)
    boxes = with_boxes(crowd(truth, people * SIGHTINGS, rng), rng, share=0.03)
    number, turn = np.divmod(np.arange(len(boxes)), SIGHTINGS)
    frames = frame + EVERY * turn
    return replace(boxes, frame=frames, time_s=frames / 30.0, track=number)


def published(tilt_deg=23.0, roll_deg=0.4, height_m=8.5, **more) -> Calibration:
    """What the files say: higher, and over level ground."""
    return Calibration.of_camera(camera(tilt_deg, roll_deg, height_m, **more))


def sigmas(found: Calibration) -> tuple[float, float, float]:
    """Of roll, tilt (rad) and height (m)."""
    assert found.camera is not None
    _, tilt, roll, height, *_ = np.sqrt(np.diag(found.parameter_covariance))
    return roll, tilt, height * found.camera.height_m


@pytest.fixture(scope="module")
def ground() -> Ground:
    """Of people 7 m below a camera that is published at 8.5 m and a degree steeper."""
    return local_ground("G424", published(), [clip(camera())])


def off(found: Calibration, truth: Camera) -> np.ndarray:
    """Errors of roll, tilt (rad) and height (m)."""
    assert found.camera is not None
    return np.array(
        [
            found.camera.roll_rad - truth.roll_rad,
            found.camera.tilt_rad - truth.tilt_rad,
            found.camera.height_m - truth.height_m,
        ]
    )


def check(ground: Ground, truth: Camera) -> None:
    """Right within the stated error, which is no excuse: a degree, and 6 % of the height. But what
    all people share (lean, mean height, the lens) is in it, which no number of them averages out.
    """
    assert ground.reason == ""
    wrong, spread = np.abs(off(ground.calibration, truth)), np.array(sigmas(ground.calibration))
    assert (wrong < 2.5 * spread).all()
    assert np.radians(0.3) < spread[1] < np.radians(1.0)
    assert spread[2] < 0.06 * truth.height_m
    assert wrong[1] < np.radians(0.8)
    assert wrong[2] < 0.05 * truth.height_m
    assert abs(off(ground.published, truth)[2]) > 0.2 * truth.height_m


def test_the_people_tell_height_tilt_and_roll(ground):
    check(ground, camera())


@pytest.mark.parametrize(
    ("true", "said"),
    [
        ((15.0, -1.5, 9.0), (14.5, 0.0, 6.5)),
        ((35.0, 0.5, 5.5), (34.5, 0.0, 7.0)),
    ],
)
def test_wherever_the_camera_hangs(true, said):
    truth = camera(*true)
    check(local_ground("G1", published(*said), [clip(truth, seed=1)]), truth)


def test_focal_length_and_lens_are_the_published_ones(ground):
    before, found = ground.published.camera, ground.calibration.camera
    assert found.focal_px == pytest.approx(before.focal_px, rel=1e-6)
    np.testing.assert_array_equal(found.distortion, before.distortion)
    assert found.image_size == SIZE


@pytest.mark.parametrize(("people", "low", "high"), [(2, 25.0, 27.0), (PEOPLE, 21.0, 25.0)])
def test_the_published_tilt_is_believed_until_enough_people_say_otherwise(people, low, high):
    """22° in truth, and published as 27°."""
    annotated = clip(camera(tilt_deg=22.0), people=people)
    found = local_ground("G1", published(tilt_deg=27.0), [annotated]).calibration
    assert low < np.degrees(found.camera.tilt_rad) < high


@pytest.mark.parametrize("kind", ["nobody", "cars alone", "no row on the second"])
def test_without_people_it_is_the_published_one_and_says_why(kind):
    before, people = published(), clip(camera(), people=5)
    annotated = {
        "nobody": people.select(np.zeros(len(people), bool)),
        "cars alone": replace(people, class_name=np.full(len(people), "car")),
        "no row on the second": replace(people, frame=people.frame + 1),
    }[kind]
    ground = local_ground("G7", before, [annotated])
    assert ground.calibration is before
    assert ground.reason
    assert ground.reason in str(ground)
    assert "as published, tilt 23.0°, height 8.5 m" in str(ground)
    assert str(ground).startswith("G7: ")


def test_what_is_said_names_both(ground):
    found = re.fullmatch(
        r"G424: tilt ([\d.]+) ± ([\d.]+)°, height ([\d.]+) ± ([\d.]+) m "
        r"\(published: tilt 23\.0°, height 8\.5 m\)",
        str(ground),
    )
    assert found, str(ground)
    tilt, tilt_sigma, height, height_sigma = map(float, found.groups())
    assert tilt == pytest.approx(np.degrees(ground.calibration.camera.tilt_rad), abs=0.051)
    assert height == pytest.approx(ground.calibration.camera.height_m, abs=0.051)
    _, tilt_rad, height_m = sigmas(ground.calibration)
    assert tilt_sigma == pytest.approx(np.degrees(tilt_rad), abs=0.051)
    assert height_sigma == pytest.approx(height_m, abs=0.051)
    why = Ground("G424", ground.published, ground.published, "too few people")
    assert str(why) == "G424: as published, tilt 23.0°, height 8.5 m (too few people)"


def test_people_of_several_clips_are_different_people():
    """The same numbers again in another clip: twice as many people, none of them seen twice."""
    truth, before = camera(), published()
    first, second = clip(truth, seed=4, people=12), clip(truth, seed=5, people=12)
    apart = replace(second, track=second.track + 100)
    shifted = local_ground("G1", before, [first, second]).calibration
    expected = local_ground("G1", before, [Detections.concatenate([first, apart])]).calibration
    assert shifted.camera.height_m == pytest.approx(expected.camera.height_m, rel=1e-6)
    assert sigmas(shifted) == pytest.approx(sigmas(expected), rel=1e-6)
    mixed = local_ground("G1", before, [Detections.concatenate([first, second])]).calibration
    assert sigmas(mixed) != pytest.approx(sigmas(expected), rel=1e-3)


def test_only_whole_seconds_and_people_are_looked_at(ground):
    """Rows between and vehicles change nothing, however wrong."""
    people, wrong = clip(camera()), clip(camera(height_m=4.0), seed=7)
    between = replace(wrong, frame=wrong.frame + 7)
    cars = replace(wrong, class_name=np.full(len(wrong), "car"))
    more = local_ground("G1", published(), [Detections.concatenate([people, between, cars])])
    height_m = ground.calibration.camera.height_m
    assert more.calibration.camera.height_m == pytest.approx(height_m, rel=1e-9)


def test_a_clip_without_people_and_vehicles_has_no_tracks():
    """MEVA has such clips: their boxes are of bags and doors, or there are none."""
    nobody = Detections.from_boxes(SIZE, np.empty(0, np.int64), np.empty((0, 4)))
    known = published()
    assert len(meva._followed(nobody, Ground("G7", known, known))) == 0
