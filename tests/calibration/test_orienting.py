"""Reading the orientation of footage: which frames, what is told of them, and how it is said."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from readings import belief_of, reading_of
from scene4d.calibration.orienting import (
    MOST_FRAMES,
    NAMES,
    halving_order,
    read_orientation,
    settled,
)
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.perception.orientation import Belief, PoseReader

SIZE = (160, 90)
CAMERA = Camera.from_pose(
    image_size=SIZE, focal_px=150.0, tilt_rad=0.3, roll_rad=-0.04, height_m=6.0
)


@pytest.fixture
def network(monkeypatch):
    """Replaces the network by a list of beliefs, which repeats; gives the pictures it was shown."""

    def use(*beliefs: Belief) -> list[np.ndarray]:
        shown: list[np.ndarray] = []

        def belief(self, image_bgr: np.ndarray) -> Belief:
            shown.append(image_bgr)
            return beliefs[(len(shown) - 1) % len(beliefs)]

        monkeypatch.setattr(PoseReader, "belief", belief)
        return shown

    return use


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Forty pictures, each as grey as its number."""
    images = tmp_path / "images"
    images.mkdir()
    for i in range(40):
        cv2.imwrite(str(images / f"{i}.png"), np.full((SIZE[1], SIZE[0], 3), 5 * i, np.uint8))
    return images


@given(st.integers(1, 500))
def test_the_order_is_all_frames_and_begins_far_apart(n):
    order = halving_order(n)
    assert sorted(order.tolist()) == list(range(n))
    first = np.sort(order[: min(n, 4)])
    if n >= 8:
        assert np.diff(first).min() >= n / 8


def test_frames_that_agree_are_soon_enough(network, folder):
    shown = network(belief_of(CAMERA))
    reading = read_orientation(folder)
    assert reading.frames == len(shown) == 16
    indices = sorted(index for index, _ in reading.by_frame)
    assert indices[0] < 5 and indices[-1] > 34
    assert np.diff(indices).max() <= 4
    assert sorted(int(image[0, 0, 0]) // 5 for image in shown) == indices


def test_frames_that_disagree_are_all_looked_at(network, folder):
    """What comes later says something else each time: nothing ever settles."""
    steps = [belief_of(CAMERA, tilt_deg=0.4 * i, sigma=0.5) for i in range(40)]
    network(*steps)
    assert read_orientation(folder).frames == 40


def test_settled_is_measured_in_standard_deviations():
    before = belief_of(CAMERA, sigma=3.0)
    assert settled(before, belief_of(CAMERA, tilt_deg=0.5, sigma=3.0), SIZE)
    assert not settled(before, belief_of(CAMERA, tilt_deg=2.0, sigma=3.0), SIZE)
    assert not settled(before, belief_of(CAMERA, roll_deg=2.0, sigma=3.0), SIZE)


def test_a_number_of_frames_is_kept(network, folder):
    network(belief_of(CAMERA))
    assert read_orientation(folder, frames=7).frames == 7
    assert read_orientation(folder / "3.png").frames == 1
    for wrong in (0, MOST_FRAMES + 1):
        with pytest.raises(InputError, match=f"1 to {MOST_FRAMES}"):
            read_orientation(folder, frames=wrong)


def test_the_reading_is_the_belief_in_pixels_of_the_whole_picture():
    reading = reading_of(belief_of(CAMERA), image_size=SIZE)
    values = reading.to_dict()
    assert set(values) == {"focal_px", "tilt_deg", "roll_deg", "vfov_deg", "sigma", "frames"}
    assert values["tilt_deg"] == pytest.approx(np.degrees(0.3), abs=0.1)
    assert values["roll_deg"] == pytest.approx(np.degrees(-0.04), abs=0.1)
    assert values["focal_px"] == pytest.approx(150.0, rel=0.02)
    # 16:9 has its full height in the 4:3 crop: the fields of view are the same.
    assert values["vfov_deg"] == pytest.approx(np.degrees(2 * np.arctan(45 / 150)), rel=0.02)
    f, s = values["focal_px"], values["sigma"]["focal_px"]
    ends = [np.degrees(2 * np.arctan(45 / (f * np.exp(x * s / f)))) for x in (-0.01, 0.01)]
    assert values["sigma"]["vfov_deg"] == pytest.approx((ends[0] - ends[1]) / 0.02, rel=1e-3)


def test_of_a_tall_picture_the_crop_sees_less_than_the_whole():
    tall = Camera.from_pose(
        image_size=(90, 160), focal_px=150.0, tilt_rad=0.3, roll_rad=0.0, height_m=6.0
    )
    values = reading_of(belief_of(tall), image_size=tall.image_size).to_dict()
    assert values["focal_px"] == pytest.approx(150.0, rel=0.02)
    assert values["vfov_deg"] == pytest.approx(np.degrees(2 * np.arctan(80 / 150)), rel=0.02)


def test_calibrate_reads_what_is_written(tmp_path):
    reading = reading_of(belief_of(CAMERA), image_size=SIZE)
    file = tmp_path / "orientation.json"
    file.write_text(json.dumps(reading.to_dict()))
    told = Orientation.load(file)
    for name in vars(told):
        assert getattr(told, name) == pytest.approx(getattr(reading.orientation, name))


def test_the_interval_holds_what_is_read():
    reading = reading_of(belief_of(CAMERA), image_size=SIZE)
    values = reading.to_dict()
    for name, (low, high) in reading.intervals.items():
        assert low < values[name] < high
        assert high - low == pytest.approx(3.92 * values["sigma"][name], rel=0.2)


def test_a_lens_is_taken_out_and_believed(network, tmp_path):
    lens = Lens(SIZE, CAMERA.K, np.array([-0.3, 0, 0, 0, 0.0]))
    noise = np.random.default_rng(0).integers(0, 255, (90, 160, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "one.png"), noise)
    shown = network(Belief.even())
    reading = read_orientation(tmp_path / "one.png", lens=lens)
    assert not np.array_equal(shown[0], noise)
    assert reading.orientation.focal_px == 150.0 and reading.orientation.focal_sigma_px == 0
    assert reading.to_dict()["sigma"]["vfov_deg"] == 0
    vfov = 2 * np.arctan(45 / 150)
    assert reading.belief.mean()[2] == pytest.approx(vfov, rel=0.03)
    assert reading.vague == ("roll_deg", "tilt_deg")
    np.testing.assert_array_equal(reading.camera.distortion, lens.distortion)
    with pytest.raises(InputError, match="aspect ratio"):
        read_orientation(tmp_path / "one.png", lens=Lens((100, 100), np.diag([90.0, 90.0, 1.0])))


def test_the_mode_is_the_papers(network):
    often, once = belief_of(CAMERA), belief_of(CAMERA, tilt_deg=20.0)
    reading = reading_of(often, once, often, image_size=SIZE)
    found = reading.most_frequent
    values = found.roll_rad, found.tilt_rad, found.focal_px
    assert values == pytest.approx((CAMERA.roll_rad, CAMERA.tilt_rad, CAMERA.focal_px), rel=1e-6)
    assert reading.most_frequent.tilt_sigma_rad == reading.orientation.tilt_sigma_rad


def test_what_pictures_do_not_tell_is_named():
    assert reading_of(Belief.even(), image_size=SIZE).vague == NAMES
    assert reading_of(belief_of(CAMERA), image_size=SIZE).vague == ()


def test_one_frame_by_itself():
    beliefs = belief_of(CAMERA), belief_of(CAMERA, tilt_deg=10.0)
    reading = reading_of(*beliefs, image_size=SIZE)
    alone = reading.of_frame(1)
    assert alone is not None and alone.frames == 1
    assert alone.orientation.tilt_rad == pytest.approx(0.3 + np.radians(10), abs=0.01)
    assert reading.of_frame(7) is None


def test_the_true_network_refuses_what_is_too_small(tmp_path):
    cv2.imwrite(str(tmp_path / "tiny.png"), np.zeros((20, 30, 3), np.uint8))
    with pytest.raises(InputError, match="too small"):
        read_orientation(tmp_path / "tiny.png")


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_the_true_network_is_in_the_package_and_answers(tmp_path, grey):
    cv2.imwrite(str(tmp_path / "even.png"), np.full((90, 160, 3), grey, np.uint8))
    reading = read_orientation(tmp_path / "even.png")
    assert np.isfinite(list(reading.to_dict()["sigma"].values())).all()


def test_a_camera_that_moves_is_noted(network, tmp_path):
    network(belief_of(CAMERA))
    rng = np.random.default_rng(3)
    scene = cv2.resize(
        rng.integers(0, 255, (60, 100, 3)).astype(np.uint8), (800, 480),
        interpolation=cv2.INTER_CUBIC,
    )  # fmt: skip
    for i in range(6):
        cv2.imwrite(str(tmp_path / f"{i}.png"), scene[40:400, 30 * i : 30 * i + 480])
    (note,) = read_orientation(tmp_path).notes
    assert "mixes several views" in note and "the camera moves" in note
