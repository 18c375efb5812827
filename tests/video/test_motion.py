"""A moving camera is noticed; people, light, noise and plain walls are not taken for one."""

import cv2
import numpy as np
import pytest

from scene4d.video.motion import MotionMonitor, MotionVerdict
from scene4d.video.reader import open_source
from scene4d.video.sampling import sample_frames


def watch(frames) -> MotionVerdict:
    height, width = frames[0].shape[:2]
    monitor = MotionMonitor((width, height))
    for i, frame in enumerate(frames):
        monitor.add(frame, i / 2)
    return monitor.verdict()


def view(image, shift=(0.0, 0.0), zoom=1.0, roll_deg=0.0):
    """The picture as the camera sees it after a pan (share of the width), zoom and roll."""
    height, width = image.shape[:2]
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), roll_deg, zoom)
    matrix[:, 2] += np.array(shift) * width
    return cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REFLECT)


def with_people(image, step, share=0.25, seed=5):
    """Textured figures over ``share`` of the picture, each with its own speed."""
    if share == 0:
        return image
    rng = np.random.default_rng(seed)
    height, width = image.shape[:2]
    count = 8
    w = int(np.sqrt(share * height * width / count / 2))
    out = image.copy()
    for k in range(count):
        figure = cv2.resize(rng.integers(0, 255, (10, 5, 3), dtype=np.uint8), (w, 2 * w))
        u = int(k * width / count + step * rng.uniform(-40, 40)) % (width - w)
        v = int(rng.uniform(0, height - 2 * w))
        out[v : v + 2 * w, u : u + w] = figure
    return out


def noisy(image, seed, sigma=3.0):
    noise = np.random.default_rng(seed).normal(0, sigma, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.4])
def test_a_camera_at_rest_behind_people(textured, share):
    frames = [noisy(with_people(textured, i, share), i) for i in range(16)]
    assert watch(frames) == MotionVerdict(False, 0, 15, 0.0, None)


MOVES = {
    "pan": {"shift": (0.015, 0.0)},
    "tilt": {"shift": (0.0, -0.015)},
    "zoom in": {"zoom": 1.03},
    "zoom out": {"zoom": 1 / 1.03},
    "roll": {"roll_deg": 1.5},
    "far pan": {"shift": (0.04, 0.02)},
}


@pytest.mark.parametrize("move", MOVES.values(), ids=MOVES.keys())
def test_a_move_halfway_is_noticed_behind_people_and_measured(textured, move):
    moved = view(textured, **move)
    frames = [noisy(with_people(textured if i < 8 else moved, i), i) for i in range(16)]
    verdict = watch(frames)
    assert verdict.moved
    assert verdict.frames_moved == 8
    height, width = textured.shape[:2]
    uv = np.stack(np.meshgrid(np.linspace(0, width, 9), np.linspace(0, height, 9)), -1)
    matrix = cv2.getRotationMatrix2D(
        (width / 2, height / 2), move.get("roll_deg", 0), move.get("zoom", 1)
    )
    matrix[:, 2] += np.array(move.get("shift", (0, 0))) * width
    shift = np.linalg.norm(uv @ matrix[:, :2].T + matrix[:, 2] - uv, axis=-1)
    assert verdict.max_shift_px == pytest.approx(np.sqrt((shift**2).mean()), rel=0.1)
    assert f"8 of 15 frames are shifted by up to {verdict.max_shift_px:.0f} px" in verdict.reason
    assert "from 4.0 s on" in verdict.reason


def test_a_cut_to_another_view(textured):
    other = np.ascontiguousarray(textured[::-1, ::-1])
    verdict = watch([noisy(textured if i < 6 else other, i) for i in range(12)])
    assert verdict.moved
    assert verdict.frames_moved == 6
    assert np.isnan(verdict.max_shift_px)
    assert "6 of 11 frames show another view than the first" in verdict.reason


def test_a_shaking_camera(textured):
    rng = np.random.default_rng(0)
    assert watch([view(textured, shift=rng.uniform(-0.03, 0.03, 2)) for _ in range(16)]).moved


def test_a_tremor_below_the_threshold_and_a_passing_truck_are_no_move(textured):
    rng = np.random.default_rng(0)
    tremor = [view(textured, shift=rng.uniform(-0.0015, 0.0015, 2)) for _ in range(16)]
    assert watch(tremor) == MotionVerdict(False, 0, 15, 0.0, None)
    truck = np.full_like(textured, 60)
    truck[::7] = 200
    truck[:, ::11] = 0
    passing = [truck if i in (7, 8) else noisy(textured, i) for i in range(16)]
    assert not watch(passing).moved


def test_a_train_over_most_of_the_picture_is_no_move(textured):
    train = textured.copy()
    train[:, :380] = textured[:, 20:400]
    frames = [noisy(train if i >= 4 else textured, i) for i in range(12)]
    assert watch(frames) == MotionVerdict(False, 0, 11, 0.0, None)


@pytest.mark.parametrize("gain", [0.15, 0.5, 1.8])
@pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0])
def test_a_change_of_light_is_no_move(textured, gain, gamma):
    shade = np.linspace(0.5, 1, textured.shape[1])[None, :, None]  # a shadow over one side
    lit = 255 * (np.clip(textured * gain / 255, 0, 1) ** gamma) * shade
    verdict = watch([noisy(textured if i < 4 else lit, i, 1.0) for i in range(8)])
    assert (verdict.moved, verdict.frames_moved) == (False, 0)
    assert verdict.frames_checked == 7 or gain < 0.5, "only near darkness may go unjudged"


@pytest.mark.parametrize("sigma", [0.0, 3.0, 8.0])
def test_a_plain_wall_says_nothing(sigma):
    wall = np.full((360, 640, 3), 110, np.uint8)
    verdict = watch([noisy(wall, i, sigma) for i in range(5)])
    assert (verdict.moved, verdict.frames_checked) == (False, 0)
    assert "cannot be told" in verdict.reason


def test_dark_frames_are_not_counted(textured):
    dark = np.zeros_like(textured)
    frames = [dark, textured, dark, textured, dark, textured]
    assert watch(frames) == MotionVerdict(False, 0, 2, 0.0, None)


def test_no_frames_at_all():
    verdict = MotionMonitor((640, 360)).verdict()
    assert not verdict.moved
    assert "cannot be told" in verdict.reason


def test_the_pets_camera_stands_still_until_it_is_turned(shared_data):
    source = open_source(shared_data / "pets2009" / "vtest.avi")
    frames = [f.image_bgr for f in sample_frames(source, 30)]
    assert watch(frames) == MotionVerdict(False, 0, 29, 0.0, None)
    turned = [view(f, (0.015, 0)) if i >= 20 else f for i, f in enumerate(frames)]
    verdict = watch(turned)
    assert verdict.moved
    assert verdict.frames_moved == 10
    assert verdict.max_shift_px == pytest.approx(0.015 * 768, rel=0.05)


def test_two_frames_of_a_busy_street_show_one_view_and_another_street_does_not(shared_data):
    paths = sorted((shared_data / "towncentre" / "frames").glob("*.jpg"))
    first, second = (cv2.imread(str(p)) for p in paths)
    assert watch([first, second]) == MotionVerdict(False, 0, 1, 0.0, None)
    other = cv2.imread(str(shared_data / "meva" / "frames" / "G341.jpg"))
    assert watch([first, cv2.resize(other, (1920, 1080))]).moved


def seen_from(frames, seconds=2.0):
    height, width = frames[0].shape[:2]
    monitor = MotionMonitor((width, height))
    told = [monitor.add(frame, i * seconds) for i, frame in enumerate(frames)]
    return monitor.verdict(), told


def test_a_view_that_changes_near_the_end_is_told_frame_by_frame(textured):
    """Too few frames to refuse the footage; whoever uses them can leave them out."""
    other = np.ascontiguousarray(textured[::-1, ::-1])
    for end in (other, view(textured, (0.015, 0))):
        verdict, told = seen_from([noisy(textured if i < 22 else end, i) for i in range(25)])
        assert not verdict.moved
        assert verdict.reason is None
        assert told == [True] * 22 + [False] * 3
        assert (verdict.frames_moved, verdict.moved_at_s) == (3, 44.0)


COURSES = {
    "a slow pan": (
        lambda i, n, a, b: view(a, (0.03 * i / n, 0)),
        "more and more; use a stretch of footage in which it stands still",
    ),
    "a slow zoom": (lambda i, n, a, b: view(a, zoom=1 + 0.04 * i / n), "more and more; use"),
    "turned once": (
        lambda i, n, a, b: view(a, (0.02, 0)) if i >= 10 else a,
        "from 20.0 s on; use the footage before or after 20.0 s alone",
    ),
    "two cameras in turns": (
        lambda i, n, a, b: b if i // 3 % 2 else a,
        "from 6.0 s on, and the view changes 6 times; split the footage where it changes",
    ),
    "one camera after the other": (lambda i, n, a, b: b if i >= 9 else a, "before or after 18.0 s"),
}


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES.keys())
def test_how_the_view_changes_is_said_and_what_helps(textured, course):
    frame, words = course
    other = np.ascontiguousarray(textured[::-1, ::-1])
    verdict, _ = seen_from([noisy(frame(i, 20, textured, other), i) for i in range(20)])
    assert verdict.moved
    assert words in verdict.reason
