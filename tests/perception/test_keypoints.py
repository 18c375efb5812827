import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.body import HALPE26
from scene4d.perception.keypoints import _crops, crop_transforms, decode_simcc

BOX = st.tuples(
    st.floats(-50, 2000), st.floats(-50, 2000), st.floats(1, 900), st.floats(1, 900)
).map(lambda b: np.array([[b[0], b[1], b[0] + b[2], b[1] + b[3]]]))


@given(st.floats(2, 380), st.floats(4, 12))
def test_a_bump_between_bins_is_found(centre, sigma):
    bins = np.arange(384)
    logits = np.exp(-((bins - centre) ** 2) / 2 / sigma**2)[None, None].astype(np.float32)
    position, peak = decode_simcc(logits)
    assert position[0, 0] == pytest.approx(centre, abs=0.02)
    assert peak[0, 0] == pytest.approx(1, abs=0.02)


def test_a_peak_at_either_end_or_a_plateau_stays_at_its_bin():
    ends = np.zeros((1, 3, 10), np.float32)
    ends[0, 0, 0] = ends[0, 1, 9] = 1
    position, _ = decode_simcc(ends)
    assert position.tolist() == [[0.0, 9.0, 0.0]]


@given(BOX)
def test_the_crop_holds_the_whole_box_in_its_middle(box):
    scale, shift = crop_transforms(box)
    corners = scale[0] * box.reshape(2, 2) + shift[0]
    assert corners.mean(axis=0) == pytest.approx([96, 128])
    assert (corners >= 0).all()
    assert (corners <= [192, 256]).all()
    # 1.25 times the box along the side that decides.
    used = (corners[1] - corners[0]) / np.array([192, 256])
    assert used.max() == pytest.approx(0.8)


def test_crops_are_red_first_and_normalised():
    red = np.zeros((50, 50, 3), np.uint8)
    red[..., 2] = 255
    crop = _crops(red, *crop_transforms(np.array([[20.0, 20, 30, 30]])))[0]
    assert crop.shape == (3, 256, 192)
    # ImageNet's mean and standard deviation in [0, 1], as PyTorch's documentation prints them.
    wanted = (np.array([1.0, 0, 0]) - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    assert crop[:, 128, 96] == pytest.approx(wanted, abs=1e-3)


@pytest.fixture(scope="module")
def people(pets_frames, detector):
    image = pets_frames[50].image_bgr
    return image, detector.detect(image).xyxy.astype(float)


@pytest.mark.weights
class TestOnRealPeople:
    def test_bodies_are_upright_and_inside_their_boxes(self, estimator, people):
        image, boxes = people
        uv, score = estimator.estimate(image, boxes)
        assert uv.shape == (3, 26, 2)
        assert score.min() >= 0
        assert score.max() <= 1
        assert score[:, HALPE26.index("head_top")].min() > 0.6
        height = boxes[:, 3] - boxes[:, 1]
        head = uv[:, HALPE26.index("head_top"), 1]
        feet = uv[:, [i for i, n in enumerate(HALPE26) if "toe" in n or "heel" in n], 1]
        assert np.abs((head - boxes[:, 1]) / height).max() < 0.12
        assert np.abs((feet.mean(axis=1) - boxes[:, 3]) / height).max() < 0.12
        hips = uv[:, HALPE26.index("pelvis"), 1]
        knees = uv[:, [HALPE26.index("left_knee"), HALPE26.index("right_knee")], 1].mean(axis=1)
        assert (head < hips).all()
        assert (hips < knees).all()

    @pytest.mark.parametrize("shift", [(7, 0), (0, 5), (-40, 13)])
    def test_moving_the_picture_moves_the_points(self, estimator, people, shift):
        image, boxes = people
        matrix = np.array([[1.0, 0, shift[0]], [0, 1, shift[1]]])
        moved = cv2.warpAffine(
            image, matrix, image.shape[1::-1], flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
        )  # fmt: skip
        middle = boxes[[1]]  # its crop stays clear of the picture's border
        uv, score = estimator.estimate(image, middle)
        uv_moved, _ = estimator.estimate(moved, middle + np.tile(shift, 2))
        sure = score[0] > 0.3
        assert np.abs(uv_moved - uv - shift)[0, sure].max() < 0.05

    def test_doubling_the_picture_doubles_the_points(self, estimator, people):
        image, boxes = people
        doubled = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        uv, score = estimator.estimate(image, boxes)
        uv2, _ = estimator.estimate(doubled, (boxes + 0.5) * 2 - 0.5)
        difference = ((uv2 + 0.5) / 2 - 0.5 - uv)[score > 0.5]
        # Half a pixel of slip in the doubled picture would show as 0.25 px.
        assert np.abs(np.median(difference, axis=0)).max() < 0.08
        assert np.median(np.abs(difference)) < 0.25

    def test_a_mirrored_picture_mirrors_the_middle_of_the_body(
        self, estimator, detector, pets_frames
    ):
        middle = [HALPE26.index(n) for n in ("head_top", "neck", "pelvis")]
        differences = []
        for frame in pets_frames[::10]:
            last = frame.image_bgr.shape[1] - 1
            box = detector.detect(frame.image_bgr).xyxy.astype(float)
            uv, score = estimator.estimate(frame.image_bgr, box)
            mirrored = np.ascontiguousarray(frame.image_bgr[:, ::-1])
            other, _ = estimator.estimate(
                mirrored, box[:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [last, 0, last, 0]
            )
            gap = last - other[:, middle, 0] - uv[:, middle, 0]
            differences.append(gap[score[:, middle] > 0.5])
        everyone = np.concatenate(differences)
        assert len(everyone) > 100
        # Half a pixel of slip would show as 1 px.
        assert abs(everyone.mean()) < 0.15

    def test_a_batch_is_its_members_one_by_one(self, estimator, people):
        image, boxes = people
        many = np.tile(boxes, (7, 1)) + np.arange(21)[:, None] / 10
        uv, score = estimator.estimate(image, many)
        for i in (0, 15, 16, 20):
            one, one_score = estimator.estimate(image, many[i : i + 1])
            assert np.abs(one[0] - uv[i]).max() < 0.01
            assert np.abs(one_score[0] - score[i]).max() < 1e-3

    def test_nobody(self, estimator, people):
        uv, score = estimator.estimate(people[0], np.empty((0, 4)))
        assert uv.shape == (0, 26, 2)
        assert score.shape == (0, 26)
