"""What is tried on a recording whose camera is known, with a network that knows the answer."""

from dataclasses import replace

import numpy as np
import pytest

from readings import belief_of, reading_of
from scene4d.calibration.watching import Seen
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections, Segments
from scene4d.core.progress import Silent
from scene4d.evaluation import Evaluation, Reference
from scene4d.evaluation.trials import datasets, few
from scene4d.evaluation.trials.methods import Input, trials
from strategies import build_camera, build_lens, people_scene

SIZE = (1280, 720)
CAMERA = build_camera(build_lens(SIZE, 55.0), 20.0, 1.0, 6.0)
FRAMES, EACH = 6, 6


@pytest.fixture(scope="module")
def reference() -> Reference:
    people = people_scene(CAMERA, 200, np.random.default_rng(1))
    return Reference("square", CAMERA, people.foot_uv)


@pytest.fixture
def footage(monkeypatch) -> Input:
    """Six people in each of six frames, of which the network has seen five."""
    people = people_scene(CAMERA, FRAMES * EACH, np.random.default_rng(0), noise=0.01)
    frame = np.repeat(np.arange(FRAMES), EACH)
    segments = replace(Segments.from_points(people.foot_uv, people.head_uv), frame=frame)
    for place in ("few", "methods"):
        monkeypatch.setattr(
            f"scene4d.evaluation.trials.{place}.person_segments", lambda _: segments
        )
    monkeypatch.setattr("scene4d.calibration.watching.person_segments", lambda _: segments)
    nobody = Detections.from_boxes(SIZE, np.empty(0, np.int64), np.empty((0, 4)))
    reading = reading_of(*[belief_of(CAMERA)] * (FRAMES - 1), image_size=SIZE)
    return Input("video", Seen(nobody, FRAMES, reading=reading))


def test_the_network_has_its_rows_where_there_are_pictures(footage):
    truth = Orientation(CAMERA.focal_px, CAMERA.tilt_rad, CAMERA.roll_rad)
    tried = [t.setting for t in trials(footage, truth)]
    rows = {(s.footage, s.method) for s in tried if s.given == "network"}
    assert rows == {
        ("video, boxes", "paper"), ("video, boxes", "joint"), ("video, keypoints", "joint"),
    }  # fmt: skip
    assert len(tried) == len(set(tried))
    blind = replace(footage, seen=replace(footage.seen, reading=None))
    assert not any(t.setting.given == "network" for t in trials(blind, truth))


def test_told_nothing_means_not_by_the_network_either(footage, reference):
    by_given = {
        t.setting.given: t.outcome(reference, 1.70).calibration
        for t in trials(footage, None)
        if t.setting.footage.endswith("keypoints")
    }
    nothing, network = by_given["nothing"], by_given["network"]
    assert nothing.camera is not None and network.camera is not None
    assert nothing.camera.focal_px != network.camera.focal_px


def test_few_people_are_drawn_from_frames_that_the_network_saw(footage, reference, monkeypatch):
    solved = []
    solve = few.solve_guided

    def remember(segments, size, options, reading, **known):
        solved.append((set(segments.frame.tolist()), len(segments), reading))
        return solve(segments, size, options, reading, **known)

    monkeypatch.setattr(few, "solve_guided", remember)
    monkeypatch.setattr(few, "DRAWS", 3)
    notes: list[str] = []
    steps: list[int] = []
    rows = list(few.few_people(footage, reference, notes, steps.append))
    assert [row.people for row in rows] == [3, 5]
    assert sum(steps) == 2 * 3
    (note,) = notes
    assert "no frame shows 10 people" in note
    for frames, count, reading in solved:
        assert len(frames) == 1 and frames < set(range(FRAMES - 1)) and count in (3, 5)
        if reading is not None:
            assert [index for index, _ in reading.by_frame] == list(frames)
    assert sum(reading is not None for _, _, reading in solved) == len(solved) / 2
    # A guess that is right must not leave fewer cameras than none.
    for row in rows:
        assert row.draws == 3
        assert np.isnan(row.guided_m).sum() <= np.isnan(row.alone_m).sum()


def test_draws_are_all_different_and_the_same_each_time(footage):
    segments = Segments.from_points(np.zeros((5, 2)), np.ones((5, 2)))
    first, again = (few._draws(segments, 3, {0}) for _ in range(2))
    assert len(first) == 10  # five choose three
    assert len({tuple(rows) for rows in first}) == 10
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert few._draws(segments, 3, {1}) == [] and few._draws(segments, 6, {0}) == []


def test_an_evaluation_holds_the_draws_and_lends_the_reading(footage, reference, monkeypatch):
    monkeypatch.setattr(few, "DRAWS", 2)
    monkeypatch.setattr(datasets, "DRAWS", 2)
    monkeypatch.setattr(datasets, "HEIGHTS_M", (1.70,))
    nobody = Seen(footage.seen.detections, 1)
    blind = Input("drawn boxes", nobody)
    notes: list[str] = []
    found = datasets._evaluated("pets", reference, [footage, blind], notes, Silent())
    assert isinstance(found, Evaluation)
    assert {row.footage for row in found.few} == {"video"}
    lines = {(o.setting.footage.split(",")[0], o.setting.given) for o in found.outcomes}
    assert ("drawn boxes", "network") in lines
    assert any("the same camera" in note for note in found.notes)
    assert len(found.to_dict()["few_people"]) == len(found.few) == 2
    dark = datasets._evaluated("pets", reference, [blind], [], Silent())
    assert dark.few == () and any("no pictures" in note for note in dark.notes)


def test_with_edges_the_same_people_are_tried_without_them_too(footage, reference, monkeypatch):
    monkeypatch.setattr(few, "DRAWS", 2)
    monkeypatch.setattr(few, "PEOPLE", (5,))
    edges = np.random.default_rng(0).uniform(0, 700, (30, 4))
    seen = replace(footage.seen, edges_xyxy=edges)
    rows = list(few.few_people(replace(footage, seen=seen), reference, [], lambda _: None))
    plain = list(few.few_people(footage, reference, [], lambda _: None))
    assert [row.footage for row in rows] == ["video", "video, no edges"]
    np.testing.assert_array_equal(rows[1].alone_m, plain[0].alone_m)
    np.testing.assert_array_equal(rows[1].guided_m, plain[0].guided_m)
