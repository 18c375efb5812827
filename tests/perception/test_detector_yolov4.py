import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.perception._session import open_session
from scene4d.perception.detectors._darknet import onnx_of_darknet
from scene4d.perception.weights import weight_path

PETS_VEHICLES = np.array([[651.9, 44.1, 723.2, 100.4], [734.7, 49.6, 767.5, 92.5]])
"""The parked van and the car that the border cuts; drawn by hand, good to about 2 px."""


def hand_drawn(frame: str, kind: str) -> np.ndarray:
    with (Path(__file__).parent / "meva_vehicles.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    chosen = [r for r in rows if (r["frame"], r["kind"]) == (frame, kind)]
    return np.array([[float(r[k]) for k in ("x1", "y1", "x2", "y2")] for r in chosen])


def four_wheels(found):
    return found[np.isin(found.data["class_name"], ("car", "truck", "bus"))]


@pytest.mark.weights
def test_both_parked_vehicles_of_pets_are_found_and_nothing_else(
    vehicle_detector, pets_frames, iou
):
    frames = pets_frames[::10]
    hits, others = np.zeros(2), 0
    for frame in frames:
        found = four_wheels(vehicle_detector.detect(frame.image_bgr))
        overlap = iou(found.xyxy, PETS_VEHICLES)
        hits += (overlap >= 0.7).any(axis=0)
        others += (overlap.max(axis=1) < 0.5).sum()
        # Where it stands is the bottom of its box: parked, so it is always at the same place.
        assert np.abs(found.xyxy[overlap[:, 0].argmax(), 3] - PETS_VEHICLES[0, 3]) < 6
    assert (hits >= len(frames) - 1).all()
    assert others == 0


@pytest.mark.weights
def test_car_parks_of_meva(vehicle_detector, shared_data, iou):
    whole = vehicle_detector.expecting(lambda rows: np.full(len(rows), 1000.0))
    found, false, there = {}, {}, 0
    for frame in ("G424", "G328"):
        image = cv2.imread(str(shared_data / f"meva/frames/{frame}.jpg"))
        true, unclear = hand_drawn(frame, "vehicle"), hand_drawn(frame, "unclear")
        there += len(true)
        for name, detector in (("tiles", vehicle_detector), ("whole", whole)):
            boxes = four_wheels(detector.detect(image)).xyxy
            overlap = iou(boxes, true)
            found[name] = found.get(name, 0) + (overlap >= 0.5).any(axis=0).sum()
            spare = boxes[overlap.max(axis=1) < 0.3]
            known = (iou(spare, unclear) >= 0.15).any(axis=1)
            false[name] = false.get(name, 0) + (~known).sum()
    assert there == 37
    assert found["tiles"] >= 33
    assert 27 <= found["whole"] < found["tiles"]
    assert max(false.values()) <= 2


@pytest.mark.weights
def test_bicycles_are_found_under_their_coco_names(vehicle_detector, shared_data):
    image = cv2.imread(str(shared_data / "towncentre/frames/frame_0000.jpg"))
    found = vehicle_detector.detect(image)
    kinds = set(found.data["class_name"])
    assert kinds == {"person", "bicycle"}
    assert (found.class_id[found.data["class_name"] == "bicycle"] == 1).all()
    assert (np.diff(found.confidence) <= 0).all()


@pytest.mark.weights
def test_boxes_are_those_of_the_picture_given_whatever_its_shape(vehicle_detector, pets_frames):
    image = pets_frames[0].image_bgr
    wide = cv2.resize(image, None, fx=1.5, fy=2, interpolation=cv2.INTER_CUBIC)
    once, there = (four_wheels(vehicle_detector.detect(i)).xyxy for i in (image, wide))
    # The network sees nearly the same square twice.
    back = (there + 0.5) / [1.5, 2, 1.5, 2] - 0.5
    assert len(once) == len(back) == 2
    assert np.abs(np.sort(once, axis=0) - np.sort(back, axis=0)).max() < 4
    assert abs(np.mean(np.sort(once, axis=0) - np.sort(back, axis=0))) < 1
    assert once.max() <= 767.5


@pytest.mark.weights
@pytest.mark.parametrize("size", [(608, 608), (416, 320)])
def test_the_converted_network_is_that_which_opencv_reads(
    vehicle_detector, shared_data, pets_frames, size
):
    layers, weights = weight_path("yolov4-tiny-layers"), weight_path("yolov4-tiny")
    network = cv2.dnn.readNetFromDarknet(str(layers), str(weights))
    ours = open_session(onnx_of_darknet(layers.read_text(), weights.read_bytes(), size))
    images = [cv2.imread(str(shared_data / f"meva/frames/{f}.jpg")) for f in ("G424", "G328")]
    images = [cv2.resize(i, size) for i in (pets_frames[0].image_bgr, *images)]
    blob = cv2.dnn.blobFromImages(images, 1 / 255, swapRB=True)
    found = ours.run(None, {"picture": blob})[0]
    for picture, rows in zip(blob, found, strict=True):
        network.setInput(picture[None])
        theirs = np.concatenate(network.forward(network.getUnconnectedOutLayersNames()))
        seen = theirs[:, 5:].max(axis=1) > 0.2  # below, OpenCV says 0
        assert 5 < seen.sum() < 500
        centre, half = theirs[seen, :2], theirs[seen, 2:4] / 2
        corners = np.hstack([centre - half, centre + half])
        assert np.abs((rows[seen, :4] - corners) * np.tile(size, 2)).max() < 0.1
        assert np.abs(rows[seen, 4:].max(axis=1) - theirs[seen, 5:].max(axis=1)).max() < 1e-3
        assert (rows[~seen, 4:] < 0.201).all()


SMALL = """[net]
[convolutional]
batch_normalize=1
filters=4
size=3
stride=2
pad=1
activation=leaky
"""


@pytest.mark.parametrize(
    ("layers", "numbers", "said"),
    [
        (SMALL, 10, "the file ends before the layers do"),
        (SMALL, 16 + 4 * 27 + 1, "found 125 numbers, the layers take 124"),
        (SMALL + "[shortcut]\nfrom=-3", 124, "found 'shortcut', expected"),
        (SMALL.replace("leaky", "mish"), 124, "found 'mish', expected leaky or linear"),
    ],
)
def test_layers_and_weights_that_do_not_fit_are_refused(layers, numbers, said):
    with pytest.raises(InputError, match=said):
        onnx_of_darknet(layers, bytes(20 + 4 * numbers), (64, 64))
