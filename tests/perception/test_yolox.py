import cv2
import numpy as np
import pytest

from scene4d.perception.detectors._base import Detector

pytestmark = [pytest.mark.weights, pytest.mark.shared_data]


def average_precision(found, truth, iou, threshold=0.5):
    """Area under the precision-recall curve with its envelope (PASCAL VOC 2010)."""
    rows = []
    for (boxes, scores), true in zip(found, truth, strict=True):
        overlap, free = iou(boxes, true), np.ones(len(true), bool)
        for i in np.argsort(-scores):
            options = np.where(free, overlap[i], 0) if len(true) else np.zeros(1)
            hit = bool(options.max(initial=0) >= threshold)
            if hit:
                free[options.argmax()] = False
            rows.append((scores[i], hit))
    hits = np.array([hit for _, hit in sorted(rows, key=lambda r: -r[0])])
    recall = np.cumsum(hits) / sum(len(t) for t in truth)
    precision = np.cumsum(hits) / np.arange(1, len(hits) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * envelope))


def test_the_measure_knows_good_from_bad(iou):
    truth = [np.array([[0.0, 0, 10, 20], [50, 0, 60, 20]])]
    good = [(truth[0] + 0.5, np.array([0.9, 0.8]))]
    half = [(truth[0][:1], np.array([0.9]))]
    assert average_precision(good, truth, iou) == pytest.approx(1)
    assert average_precision(half, truth, iou) == pytest.approx(0.5)
    assert average_precision([(truth[0] + 30, np.ones(2))], truth, iou) == 0


def test_people_of_pets_are_found(detector, pets_frames, pets_truth, iou):
    frames = pets_frames[::4]
    found = [detector.detect(f.image_bgr) for f in frames]
    truth = [pets_truth[f.index][0] for f in frames]
    ap = average_precision([(d.xyxy.astype(float), d.confidence) for d in found], truth, iou)
    assert ap >= 0.9


def test_small_people_need_tiles(detector, pets_frames, pets_truth, iou):
    recall = {}
    for tiles in (True, False):
        detector_here = detector.expecting(None) if tiles else large_only(detector)
        hits = total = 0
        for frame in pets_frames[:60:20]:
            image, true = into_full_hd(frame.image_bgr, pets_truth[frame.index][0])
            overlap = iou(detector_here.detect(image).xyxy, true)
            hits += (overlap.max(axis=0, initial=0) >= 0.5).sum()
            total += len(true)
        recall[tiles] = hits / total
    assert recall[True] >= 0.8
    assert recall[False] < recall[True] - 0.2


def test_people_across_tile_borders_are_found_once_and_whole(
    detector, pets_frames, pets_truth, iou
):
    found = hits = total = 0
    for frame in pets_frames[5::33]:
        image = cv2.resize(frame.image_bgr, (1920, 1440), interpolation=cv2.INTER_CUBIC)
        true = (pets_truth[frame.index][0] + 0.5) * 2.5 - 0.5
        boxes = detector.detect(image).xyxy
        found += len(boxes)
        hits += (iou(boxes, true).max(axis=1) >= 0.5).sum()
        total += len(true)
    assert hits >= 0.93 * found
    assert hits >= 0.9 * total


def large_only(detector):
    """The detector where everybody is large enough for the whole frame."""
    return detector.expecting(lambda rows: np.full(len(rows), 1000.0))


def into_full_hd(image, boxes):
    """PETS at two thirds of its size, side by side with itself mirrored, in 1920 x 1080."""
    small = cv2.resize(image, (512, 384), interpolation=cv2.INTER_AREA)
    out = np.full((1080, 1920, 3), 100, np.uint8)
    all_boxes = []
    for x, y in ((60, 30), (700, 400), (1340, 650)):
        out[y : y + 384, x : x + 512] = small
        all_boxes.append((boxes + 0.5) * 2 / 3 - 0.5 + np.array([x, y, x, y]))
    return out, np.concatenate(all_boxes)


def test_known_sizes_switch_tiles_off(detector, pets_frames):
    image = cv2.resize(pets_frames[50].image_bgr, (1536, 1152))
    large = detector.expecting(np.full(1152, 160.0))
    off = large_only(detector)
    assert np.array_equal(large.detect(image).xyxy, off.detect(image).xyxy)
    assert detector.expected_person_px is None


@pytest.mark.parametrize("shape", [(576, 768), (97, 31), (40, 1500), (1, 1)])
def test_nobody_in_an_empty_picture_of_any_shape(detector, shape):
    assert isinstance(detector, Detector)
    found = detector.detect(np.full((*shape, 3), 128, np.uint8))
    assert found.xyxy.shape == (0, 4)
    assert len(found.confidence) == 0


def test_boxes_follow_the_picture_when_it_is_doubled(detector, pets_frames):
    image = pets_frames[50].image_bgr
    off = large_only(detector)
    once = off.detect(image)
    twice = off.detect(cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))
    assert len(once) == len(twice) == 3
    first = once.xyxy[np.argsort(once.xyxy[:, 0])]
    second = twice.xyxy[np.argsort(twice.xyxy[:, 0])]
    assert np.abs((first + 0.5) * 2 - 0.5 - second).max() < 5
    assert abs(np.mean((first + 0.5) * 2 - 0.5 - second)) < 0.5
