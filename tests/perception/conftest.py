"""Weights for the tests that look at real pictures, and the hand-drawn boxes of PETS."""

import os
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import cv2
import defusedxml.ElementTree
import numpy as np
import pytest

from scene4d.core.errors import UnavailableError
from scene4d.perception.detectors._yolov4 import Yolov4TinyDetector
from scene4d.perception.detectors.yolox import YoloxDetector
from scene4d.perception.keypoints import KeypointEstimator
from scene4d.perception.weights import weight_path

Truth = dict[int, tuple[np.ndarray, np.ndarray]]


def _weight(name: str) -> Path:
    try:
        return weight_path(name)
    except UnavailableError as error:
        if os.environ.get("CI"):
            raise
        return pytest.skip(f"the weight {name} cannot be had here: {error}")


@pytest.fixture(scope="session")
def detector() -> YoloxDetector:
    _weight("yolox-tiny")
    return YoloxDetector()


@pytest.fixture(scope="session")
def vehicle_detector() -> Yolov4TinyDetector:
    _weight("yolov4-tiny")
    return Yolov4TinyDetector()


@pytest.fixture(scope="session")
def estimator() -> KeypointEstimator:
    _weight("rtmpose-s")
    return KeypointEstimator()


@pytest.fixture(scope="session")
def pets_truth(shared_data: Path) -> Truth:
    """Hand-drawn boxes (n, 4) and identities (n,) per frame of PETS S2L1."""
    truth = {}
    for frame in defusedxml.ElementTree.parse(shared_data / "pets2009/PETS2009-S2L1.xml").getroot():
        boxes, ids = [], []
        for thing in frame.iter("object"):
            h, w, x, y = (float(thing.find("box").get(k)) for k in ("h", "w", "xc", "yc"))
            boxes.append([x - w / 2, y - h / 2, x + w / 2, y + h / 2])
            ids.append(int(thing.get("id")))
        truth[int(frame.get("number"))] = (np.array(boxes).reshape(-1, 4), np.array(ids))
    return truth


@pytest.fixture(scope="session")
def pets_frames(shared_data: Path) -> list[SimpleNamespace]:
    """Every eighth frame of PETS S2L1, 0.8 s apart."""
    return list(_frames(shared_data / "pets2009/vtest.avi", 8))


def _frames(path: Path, step: int) -> Iterator[SimpleNamespace]:
    video = cv2.VideoCapture(str(path))
    index = 0
    while video.grab():
        if index % step == 0:
            image = video.retrieve()[1]
            yield SimpleNamespace(index=index, time_s=index / 10, image_bgr=image)
        index += 1


@pytest.fixture(scope="session")
def iou():
    """Intersection over union (n, m), written anew: not the code under test."""

    def matrix(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        out = np.zeros((len(a), len(b)))
        for i, p in enumerate(a):
            for j, q in enumerate(b):
                w = max(0.0, min(p[2], q[2]) - max(p[0], q[0]))
                h = max(0.0, min(p[3], q[3]) - max(p[1], q[1]))
                areas = (p[2] - p[0]) * (p[3] - p[1]) + (q[2] - q[0]) * (q[3] - q[1])
                out[i, j] = w * h / (areas - w * h)
        return out

    return matrix
