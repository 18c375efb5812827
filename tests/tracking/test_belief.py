"""How probable it is that a track is real."""

from dataclasses import replace

import numpy as np
import pytest

from scene4d.core.body import HALPE26
from scene4d.core.calibration import Calibration
from scene4d.core.people import Detections
from scene4d.store.log import Look
from scene4d.tracking._belief import Belief
from scene4d.tracking.following import follow
from walks import CAMERA, SIZE, detections

RATE_HZ = 5.0


def boxes(n, move, height=100.0, at=(300.0, 200.0), seed=0):
    """A person's boxes (n, 4), whose places spread by ``move`` heights: jitter, or a walk."""
    rng = np.random.default_rng(seed)
    way = np.linspace(-0.5, 0.5, n) if move > 0.2 else rng.normal(0, 1, n)
    way = (way - way.mean()) / max(way.std(), 1e-9) * move * height
    box = np.array([0, 0, 0.4 * height, height]) + np.tile(at, 2)
    return box + way[:, None] * np.array([1, 0, 1, 0])


def sees(box, time_s, score, body, class_name="person", others=None):
    """A frame with one object, and boxes of others that are surely real."""
    others = np.empty((0, 4)) if others is None else others
    n = 1 + len(others)
    keypoints = np.full((n, 26), 0.05)
    keypoints[0, :5] = body
    keypoints[1:, :5] = 0.8
    return Detections.from_boxes(
        SIZE, np.full(n, round(time_s * RATE_HZ)), np.vstack([box, others]),
        time_s=np.full(n, time_s), score=np.append(score, np.full(len(others), 0.85)),
        class_name=np.array([class_name] + ["person"] * len(others)), keypoint_names=HALPE26,
        keypoint_uv=np.full((n, 26, 2), 120.0), keypoint_score=keypoints,
    )  # fmt: skip


def watched(belief, track, box, score, body, *, begun_s=0.0, chances=None, **more):
    """Show a track's boxes, spread evenly over the chances; the probability afterwards."""
    n = len(box)
    frames = set(np.round(np.linspace(0, (chances or n) - 1, n)).astype(int).tolist())
    found = iter(box)
    for k in range(chances or n):
        time_s = begun_s + k / RATE_HZ
        if k in frames:
            seen = sees(next(found), time_s, score, body, **more)
            belief.add(time_s, np.append(track, np.arange(1000, 999 + len(seen))), seen)
        elif more.get("others") is None:
            belief.add(time_s, np.empty(0, np.int64), Detections.from_boxes(
                SIZE, np.empty(0, np.int64), np.empty((0, 4))
            ))  # fmt: skip
        else:
            seen = sees(box[0], time_s, score, body, **more).select(
                np.arange(1, 1 + len(more["others"]))
            )
            belief.add(time_s, np.arange(1000, 1000 + len(seen)), seen)
    return float(belief.probability(np.array([track]))[0])


MEASURED = [
    # What it is, sightings, chances, scores of detector and keypoints, height in pixels, movement
    # in heights: tracks of PETS 2009, both lab cameras, streets and the lobby, judged by eye.
    ("signpost, PETS", 6, 19, 0.43, 0.17, 31, 0.076, False),
    ("signpost, PETS", 7, 10, 0.46, 0.24, 30, 0.059, False),
    ("signpost, PETS", 5, 7, 0.43, 0.31, 29, 0.010, False),
    ("far walker, PETS", 96, 96, 0.75, 0.47, 37, 2.2, True),
    ("walker, PETS", 343, 347, 0.80, 0.71, 66, 1.6, True),
    ("chair with a bag, lab", 37, 45, 0.53, 0.30, 278, 0.006, False),
    ("chair with a bag, lab", 75, 164, 0.44, 0.32, 281, 0.004, False),
    ("chair, lab", 8, 49, 0.58, 0.34, 166, 0.005, False),
    ("chair, lab", 34, 37, 0.62, 0.38, 113, 0.014, False),
    ("seated, other lab camera", 15, 20, 0.45, 0.63, 261, 0.012, True),
    ("walker, other lab camera", 264, 268, 0.84, 0.86, 380, 0.65, True),
    ("hydrant, crosswalk", 28, 58, 0.44, 0.20, 20, 0.033, False),
    ("standing with a bicycle, crosswalk", 62, 65, 0.66, 0.35, 31, 0.043, True),
    ("far walker, crosswalk", 22, 27, 0.53, 0.25, 25, 3.0, True),
    ("bollard, road", 111, 128, 0.58, 0.30, 105, 0.015, False),
    ("receptionist, lobby", 53, 83, 0.52, 0.46, 92, 0.178, True),
    ("seated far away, lobby", 29, 41, 0.60, 0.42, 43, 0.143, True),
]


@pytest.mark.parametrize(("what", "n", "chances", "score", "body", "px", "move", "real"), MEASURED)
def test_things_are_told_from_people(what, n, chances, score, body, px, move, real):
    found = watched(Belief(), 3, boxes(n, move, px), score, body, chances=chances)
    assert found > 0.5 if real else found < 0.3, (what, found)


def test_who_never_sways_becomes_a_thing_with_time():
    def after(seconds, move):
        n = int(seconds * RATE_HZ)
        return watched(Belief(), 3, boxes(n, move), 0.5, 0.5)

    mannequin = [after(s, 0.012) for s in (2, 20, 120)]
    assert mannequin[0] > mannequin[1] > mannequin[2]
    assert mannequin[2] < 0.35
    assert after(120, 0.07) > 0.9  # who stands and sways
    assert after(20, 1.0) > 0.99  # who came walking


def test_what_was_still_at_a_place_tells_of_what_comes_there():
    fresh, taken = Belief(), Belief()
    still = boxes(10, 0.015)
    watched(taken, 3, still, 0.45, 0.3)
    later = {"begun_s": 60.0}
    before = watched(fresh, 4, boxes(10, 0.02, seed=1), 0.5, 0.5, **later)
    after = watched(taken, 4, boxes(10, 0.02, seed=1), 0.5, 0.5, **later)
    assert after < before - 0.05
    elsewhere = watched(taken, 5, boxes(10, 0.02, at=(100.0, 100.0)), 0.5, 0.5, begun_s=120.0)
    assert elsewhere > after + 0.05


def test_who_is_hidden_is_not_missing():
    box = boxes(8, 0.1)
    before = box[:1] + np.array([-10, 20, 10, 40])  # stands nearer, and covers most of it
    seen = {"score": 0.5, "body": 0.45, "chances": 40}
    in_front = watched(Belief(), 3, box, **seen, others=before)
    beside = watched(Belief(), 3, box, **seen, others=before + np.array([200, 0, 200, 0]))
    assert in_front > beside + 0.1


def test_parked_vehicles_stay_real_and_seen_once_is_hardly_anything():
    parked = boxes(600, 0.01, 60)
    assert watched(Belief(), 3, parked, 0.9, 0.0, class_name="car") > 0.99
    assert watched(Belief(), 3, boxes(1, 0.0), 0.45, 0.3) < 0.1
    assert Belief().probability(np.array([7])) == [0.0]


def test_it_does_not_matter_how_frames_are_batched():
    table = Detections.concatenate([detections(k) for k in range(60)])
    table = replace(table, score=np.full(len(table), 0.6))
    clock = np.arange(60)
    whole = [Look(clock, clock / 10, table)]
    each = [Look(clock[k : k + 1], clock[k : k + 1] / 10, detections(k)) for k in range(60)]
    each = [replace(one, detections=replace(one.detections, score=np.full(3, 0.6))) for one in each]
    calibration = Calibration.of_camera(CAMERA)
    a, b = (
        np.concatenate([
            part.existence_probability for part in follow(looks, calibration, 1.7, trusted=False)
        ])
        for looks in (whole, each)
    )  # fmt: skip
    assert len(a) == 180
    assert np.array_equal(a, b)
    assert ((a > 0.5) & (a < 1.0)).all()


def test_a_forgotten_track_leaves_no_memory():
    belief = Belief()
    watched(belief, 3, boxes(10, 0.015), 0.45, 0.3)
    belief.forget(1e9)
    assert belief.probability(np.array([3])) == [0.0]
    assert not belief._places
