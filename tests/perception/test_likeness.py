"""What looks like a person, track by track."""

import numpy as np
import pytest

from scene4d.core.people import Detections
from scene4d.perception.likeness import body_score, unlike_people

NAMES = tuple(f"k{number}" for number in range(10))


def seen(track, score, body, height_px, *, step_s=0.1, best=None):
    """Detections with these scores of the detector and of all keypoints."""
    n = len(track)
    box = np.column_stack([np.zeros((n, 2)), np.full(n, 20.0), np.broadcast_to(height_px, n)])
    keypoints = np.broadcast_to(np.asarray(body, float)[..., None], (n, 10)).copy()
    return Detections.from_boxes(
        (640, 480),
        np.arange(n),
        box,
        time_s=np.arange(n) * step_s,
        track=np.asarray(track),
        score=np.broadcast_to(np.asarray(score, float), n).copy(),
        keypoint_uv=np.zeros((n, 10, 2)),
        keypoint_score=keypoints,
        keypoint_names=NAMES,
    )


@pytest.mark.parametrize(
    ("score", "body", "height_px", "unlike"),
    [
        (0.87, 0.82, 120.0, False),  # a walker
        (0.62, 0.35, 30.0, False),  # one far away
        (0.50, 0.57, 150.0, False),  # somebody who sits behind a table
        (0.62, 0.36, 60.0, True),  # a lamp before a tree
        (0.50, 0.25, 200.0, True),  # a signpost
    ],
)
def test_people_and_things(score, body, height_px, unlike):
    assert (unlike_people(seen([4] * 6, score, body, height_px)) == unlike).all()


def test_a_track_is_judged_as_a_whole():
    """One good look at a signpost makes no person of it, nor a bad one of a person none."""
    body = np.array([0.2, 0.2, 0.6, 0.2, 0.85, 0.85, 0.3, 0.85])
    score = np.array([0.6, 0.6, 0.6, 0.6, 0.9, 0.9, 0.6, 0.9])
    both = seen([1, 1, 1, 1, 2, 2, 2, 2], score, body, 60.0)
    assert unlike_people(both).tolist() == [True] * 4 + [False] * 4
    alone = seen([-1] * 8, score, body, 60.0)
    assert unlike_people(alone).tolist() == [True, True, False, True, False, False, True, False]


def test_without_times_and_without_keypoints():
    timeless = seen([1] * 4, 0.9, 0.8, 100.0, step_s=np.nan)
    assert not unlike_people(timeless).any()
    bare = timeless.without_keypoints()
    assert np.isnan(body_score(bare)).all()
    assert not unlike_people(bare).any()


def test_nobody():
    assert not len(unlike_people(seen([], [], [], [])))
