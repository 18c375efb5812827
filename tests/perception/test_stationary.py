import numpy as np

from scene4d.core.people import Detections
from scene4d.perception.stationary import stationary


def person(feet, height=100.0):
    u, v = np.asarray(feet, float).T
    return np.column_stack([u - height / 5, v - height, u + height / 5, v])


def table(*clips):
    """Clips of (times, boxes) in one table, ordered by time, two frames a second."""
    time = np.concatenate([c[0] for c in clips])
    boxes = np.concatenate([c[1] for c in clips])
    order = np.argsort(time, kind="stable")
    frame = np.round(time * 2).astype(int)
    detections = Detections.from_boxes((1920, 1080), frame[order], boxes[order], time_s=time[order])
    owner = np.repeat(np.arange(len(clips)), [len(c[0]) for c in clips])[order]
    return detections, owner


def mannequin(rng, duration, seen=1.0):
    time = np.arange(0, duration, 0.5)
    time = time[rng.random(len(time)) < seen]
    return time, person(np.full((len(time), 2), [300, 400])) + rng.normal(0, 1, (len(time), 4))


def walker(duration, row=700, start=0.0):
    time = np.arange(start, start + duration, 0.5)
    return time, person(np.column_stack([100 + 80 * (time - start), np.full(len(time), row)]))


def stander(rng, start, end, at=(900, 600)):
    """Someone who waits: sways and turns by a few percent of their height."""
    time = np.arange(start, end, 0.5)
    sway = np.cumsum(rng.normal(0, 2.5, (len(time), 2)), axis=0)
    return time, person(np.asarray(at) + sway) + rng.normal(0, 1, (len(time), 4))


def test_a_mannequin_is_found_and_the_living_are_not():
    rng = np.random.default_rng(1)
    detections, owner = table(
        mannequin(rng, 60, seen=0.8), walker(20), walker(20, 300, 25), stander(rng, 10, 25)
    )
    found = stationary(detections)
    assert found[owner == 0].mean() > 0.97
    assert not found[owner != 0].any()


def test_who_stands_for_ten_seconds_stays():
    still = np.arange(10, 20, 0.5), person(np.full((20, 2), [900, 600]))
    detections, _ = table(walker(60), still)
    assert not stationary(detections).any()


def test_who_waits_through_the_clip_but_moves_stays():
    detections, _ = table(stander(np.random.default_rng(2), 0, 60), walker(30))
    assert not stationary(detections).any()


def test_many_who_pass_one_spot_stay():
    clips = [walker(20, 700, start) for start in range(0, 100, 10)]
    detections, _ = table(*clips)
    assert not stationary(detections).any()


def test_of_a_short_clip_or_without_times_nothing_is_said():
    rng = np.random.default_rng(3)
    assert not stationary(table(mannequin(rng, 15))[0]).any()
    long, _ = table(mannequin(rng, 60))
    assert stationary(long).any()
    few = long.select(np.arange(0, len(long), 20))
    assert not stationary(few).any()
    timeless = Detections.from_boxes((1920, 1080), long.frame, long.box_xyxy)
    assert not stationary(timeless).any()
    assert stationary(Detections.from_boxes((9, 9), np.empty(0), np.empty((0, 4)))).shape == (0,)


def test_nobody_of_pets_is_a_mannequin(pets_truth):
    frames = [(f, b) for f in sorted(pets_truth)[::8] for b in pets_truth[f][0]]
    index = np.array([f for f, _ in frames])
    boxes = np.array([b for _, b in frames])
    detections = Detections.from_boxes((768, 576), index, boxes, time_s=index / 10)
    assert not stationary(detections).any()


def test_ten_thousand_boxes_take_little_time():
    rng = np.random.default_rng(4)
    time = np.repeat(np.arange(1000) / 2, 10)
    boxes = person(rng.uniform(100, 1900, (10_000, 2)))
    detections = Detections.from_boxes((1920, 1080), (time * 2).astype(int), boxes, time_s=time)
    assert not stationary(detections).any()
