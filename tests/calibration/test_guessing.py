"""What the orientation network's reading is worth in a calibration: a guess, until it is asked for
by name."""

from dataclasses import replace

import numpy as np
import pytest

import scene4d
from readings import belief_of, reading_of
from scene4d.calibration import CalibrateOptions
from scene4d.calibration._guess import TILT_WIDENING, as_guess, solve_guided
from scene4d.calibration.calibrating import NO_PICTURES
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from scene4d.perception.orientation import Belief
from strategies import build_camera, build_lens, people_scene

SIZE = (1920, 1080)
CAMERA = build_camera(build_lens(SIZE, 60.0), 20.0, 1.0, 6.0)


@pytest.fixture(scope="module")
def crowd() -> Segments:
    people = people_scene(CAMERA, 120, np.random.default_rng(0), noise=0.01)
    return Segments.from_points(people.foot_uv, people.head_uv)


def at_one_distance(n: int = 6) -> Segments:
    """People side by side: they say little about the focal length."""
    rng = np.random.default_rng(2)
    xy = np.column_stack([np.linspace(-5, 5, n), np.full(n, 17.0) + rng.uniform(-0.2, 0.2, n)])
    tall = rng.normal(1.70, 0.03, n)
    foot, head = (CAMERA.project(np.column_stack([xy, z]))[0] for z in (np.full(n, 0.04), tall))
    return Segments.from_points(foot, head)


def solve(segments: Segments, *beliefs: Belief, **options: object) -> Calibration:
    reading = reading_of(*beliefs, image_size=SIZE) if beliefs else None
    return solve_guided(segments, SIZE, CalibrateOptions(**options), reading)


def network_words(found: Calibration) -> list[str]:
    return [text for text in found.warnings if "network" in text]


def values(found: Calibration) -> np.ndarray:
    c = found.camera
    assert c is not None
    return np.array([c.focal_px, c.tilt_rad, c.roll_rad, c.height_m])


def test_a_guess_that_fits_is_used_without_a_word(crowd):
    alone, guided = solve(crowd, orientation="people"), solve(crowd, belief_of(CAMERA))
    assert network_words(guided) == []
    assert not np.array_equal(values(alone), values(guided))
    assert guided.sigma["focal_px"] < alone.sigma["focal_px"]
    # Wide as it is, a crowd hardly needs it.
    np.testing.assert_allclose(values(guided), values(alone), rtol=0.05, atol=0.01)


@pytest.mark.parametrize("wrong", [{"tilt_deg": 25.0}, {"roll_deg": -12.0}])
def test_a_guess_that_the_people_contradict_is_left_out(crowd, wrong):
    alone, guided = solve(crowd, orientation="people"), solve(crowd, belief_of(CAMERA, **wrong))
    np.testing.assert_array_equal(values(guided), values(alone))
    (text,) = network_words(guided)
    assert "left out" in text
    (name,) = wrong
    read = np.degrees(CAMERA.tilt_rad if name == "tilt_deg" else CAMERA.roll_rad) + wrong[name]
    people = np.degrees(alone.camera.tilt_rad if name == "tilt_deg" else alone.camera.roll_rad)
    assert f"{name[:4]} {read:.0f}"[:7] in text and f"against {people:.1f} ±" in text


def test_few_people_agree_and_the_pictures_contradict_them(crowd):
    """Either alone is a warning; both together are no camera."""
    strays = people_scene(CAMERA, 120, np.random.default_rng(0), noise=0.01, outliers=0.55)
    segments = Segments.from_points(strays.foot_uv, strays.head_uv)
    alone = solve(segments, orientation="people")
    assert alone and alone.inliers < 0.6 * alone.people
    assert solve(segments, belief_of(CAMERA))
    found = solve(segments, belief_of(CAMERA, tilt_deg=25.0))
    assert not found and found.camera is None and found.covariance is None
    assert "agree with one camera" in found.reason and "contradicts it" in found.reason
    assert "against" in network_words(found)[0]


def test_asked_for_by_name_it_is_kept_and_the_contradiction_is_named(crowd):
    wrong = belief_of(CAMERA, tilt_deg=25.0, sigma=0.7)
    alone, kept = solve(crowd, orientation="people"), solve(crowd, wrong, orientation="network")
    if kept:
        assert kept.camera.tilt_rad > alone.camera.tilt_rad
    (text,) = network_words(kept)
    assert "was kept" in text and "against" in text
    fits = solve(crowd, belief_of(CAMERA), orientation="network")
    assert fits and network_words(fits) == []


def test_a_network_that_knows_nothing_changes_nothing(crowd):
    alone = solve(crowd, orientation="people")
    guided = solve(crowd, Belief.even())
    np.testing.assert_array_equal(values(guided), values(alone))
    assert guided.warnings == alone.warnings


@pytest.fixture
def not_widened(monkeypatch):
    """As if the network were as good on a user's camera as on its own pictures."""
    monkeypatch.setattr("scene4d.calibration._guess.TILT_WIDENING", 1.0)


@pytest.mark.usefixtures("not_widened")
def test_where_people_do_not_suffice_it_helps_and_says_so():
    few = at_one_distance()
    assert not solve(few, orientation="people")
    guided = solve(few, belief_of(CAMERA, sigma=0.5))
    assert guided, guided.reason
    (text,) = network_words(guided)
    assert "do not determine this camera" in text and "tilt 20.0 ± 1." in text
    assert values(guided)[0] == pytest.approx(CAMERA.focal_px, rel=0.3)
    assert values(guided)[3] == pytest.approx(6.0, rel=0.3)


@pytest.mark.usefixtures("not_widened")
def test_boxes_of_people_get_their_focal_length_from_it(crowd):
    boxes = replace(crowd, from_box=np.ones(len(crowd), bool))
    assert "boxes alone" in (solve(boxes, orientation="people").reason or "")
    guided = solve(boxes, belief_of(CAMERA, sigma=0.5))
    assert guided, guided.reason
    assert "boxes alone" in (solve(boxes, Belief.even()).reason or "")


def test_the_papers_method_takes_the_mode(crowd):
    often, once = belief_of(CAMERA), belief_of(CAMERA, tilt_deg=15.0)
    for word in ("network", "auto"):
        found = solve(crowd, often, once, often, orientation=word, method="paper")
        assert found and found.method == "paper"
        assert found.camera.tilt_rad == pytest.approx(CAMERA.tilt_rad, abs=1e-6)
        assert found.sigma["tilt_deg"] > 0, "the spread of the reading is part of the answer"


def test_a_paper_camera_that_the_people_contradict_is_named(crowd):
    found = solve(crowd, belief_of(CAMERA, roll_deg=15.0), orientation="network", method="paper")
    assert any("was kept" in text and "roll" in text for text in found.warnings)


def test_the_guess_is_wider_than_the_reading_and_silent_where_it_is_vague():
    stated = Orientation(1000.0, 0.3, 0.0, 200.0, 0.05, 0.04)
    guess = as_guess(stated)
    assert guess is not None
    assert guess.focal_sigma_px == pytest.approx(200.0)
    assert guess.tilt_sigma_rad == pytest.approx(TILT_WIDENING * 0.05)
    vague = as_guess(replace(stated, tilt_sigma_rad=0.3, focal_sigma_px=800.0))
    assert vague is not None
    assert np.isinf(vague.tilt_sigma_rad) and np.isinf(vague.focal_sigma_px)
    assert (
        as_guess(replace(stated, tilt_sigma_rad=0.3, focal_sigma_px=800.0, roll_sigma_rad=0.2))
        is None
    )


def test_a_picture_that_the_lens_bends_is_read_again_without_that(crowd, monkeypatch):
    bent = build_camera(build_lens(SIZE, 60.0, radial=(-0.06, 0.0, 0.0)), 20.0, 1.0, 6.0)
    people = people_scene(bent, 200, np.random.default_rng(1), noise=0.01, distorted=True)
    seen = Segments.from_points(people.foot_uv, people.head_uv)
    picture, lenses = np.zeros((SIZE[1], SIZE[0], 3), np.uint8), []

    def read(image_bgr, lens):
        assert image_bgr is picture
        lenses.append(lens)
        return reading_of(belief_of(bent), image_size=SIZE)

    monkeypatch.setattr("scene4d.calibration._guess.read_straightened", read)

    def guided(segments: Segments) -> Calibration:
        wrong = reading_of(belief_of(bent, roll_deg=15.0), image_size=SIZE)
        return solve_guided(segments, SIZE, CalibrateOptions(), wrong, image_bgr=picture)

    found = guided(seen)
    (lens,) = lenses
    corner = np.zeros((1, 2))
    moved = [np.hypot(*(each.undistort(corner)[0] - corner)[0]) for each in (lens, bent.lens)]
    assert moved[0] == pytest.approx(moved[1], rel=0.5)
    assert found and network_words(found) == [], "the second reading fits, the first did not"
    assert "roll" in " ".join(network_words(guided(crowd))), "this lens bends nothing"
    boxes = replace(seen, from_box=np.ones(len(seen), bool))
    guided(boxes)
    assert len(lenses) == 1, "boxes that belong to nobody do not tell a lens"
    guided(replace(boxes, track=np.arange(len(boxes))))
    assert len(lenses) == 2


@pytest.fixture
def boxes(tmp_path):
    file = tmp_path / "boxes.txt"
    file.write_text("1,-1,600,300,60,200,1\n1,-1,700,310,60,190,1\n1,-1,900,410,60,220,1\n")
    return file


def test_without_pictures_the_people_are_alone_and_that_is_said(boxes):
    found = scene4d.calibrate(None, CalibrateOptions(annotations=boxes, image_size=SIZE))
    assert NO_PICTURES in found.warnings
    options = CalibrateOptions(annotations=boxes, image_size=SIZE, orientation="people")
    people = scene4d.calibrate(None, options)
    assert NO_PICTURES not in people.warnings


@pytest.mark.parametrize(
    "asked", [{"orientation": "network"}, {"method": "paper"}], ids=["network", "paper"]
)
def test_without_pictures_the_network_cannot_be_asked(boxes, asked):
    with pytest.raises(InputError, match="needs pictures"):
        scene4d.calibrate(None, CalibrateOptions(annotations=boxes, image_size=SIZE, **asked))


def test_the_papers_method_needs_somebody_to_say_the_orientation():
    with pytest.raises(InputError, match="needs the camera's orientation"):
        CalibrateOptions(method="paper", orientation="people")
