"""The log of detections: nothing is lost, nothing is changed, nothing is mixed."""

import os
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from scene4d.core.body import HALPE26
from scene4d.core.errors import InputError, OutputError
from scene4d.core.people import Detections
from scene4d.store.log import DetectionLog, Look

SETTINGS = {"source": {"name": "a.avi", "size": 12}, "detector": "yolox", "thresholds": (0.1, 0.5)}


def logged(detections, appearance=None):
    """A chunk of the frames that the detections are of, and one in which nobody was."""
    frame = np.unique(detections.frame)
    frame = np.append(frame, frame.max(initial=-1) + 1)
    return Look(frame, frame / 10, detections, appearance)


def parts(log):
    return [(chunk.detections, chunk.appearance) for chunk in log.chunks()]


def seen(n, seed=0, names=HALPE26):
    rng = np.random.default_rng(seed)
    return Detections.from_boxes(
        (768, 576),
        np.arange(n),
        rng.uniform(0, 700, (n, 4)),
        time_s=rng.random(n),
        score=rng.random(n),
        class_name=np.where(rng.random(n) < 0.5, "person", "motorcycle"),
        keypoint_uv=rng.uniform(0, 700, (n, len(names), 2)),
        keypoint_score=rng.random((n, len(names))),
        keypoint_names=names,
    )


def assert_same(found, expected):
    for f in fields(Detections):
        a, b = getattr(found, f.name), getattr(expected, f.name)
        if isinstance(b, np.ndarray):
            assert a.dtype.kind == b.dtype.kind
            assert a.shape == b.shape
            assert a.tobytes() == b.astype(a.dtype).tobytes(), f.name
        else:
            assert a == b


def content(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@settings(max_examples=40, deadline=None)
@given(
    numbers=st.integers(0, 12).flatmap(lambda n: hnp.arrays(np.float64, (n, 6 + 3 * 2))),
    dtype=st.sampled_from([None, np.float32, np.float64]),
)
def test_every_bit_comes_back(tmp_path_factory, numbers, dtype):
    n = len(numbers)
    detections = Detections.from_boxes(
        (1920, 1080),
        np.arange(n),
        numbers[:, :4],
        time_s=numbers[:, 4],
        score=numbers[:, 5],
        keypoint_uv=numbers[:, 6:10].reshape(n, 2, 2),
        keypoint_score=numbers[:, 10:],
        keypoint_names=("nose", "rechter Fuß"),
    )
    appearance = None
    if dtype:
        with np.errstate(over="ignore"):
            appearance = numbers.astype(dtype)
    folder = tmp_path_factory.mktemp("log")
    DetectionLog(folder, SETTINGS).append(logged(detections, appearance))
    (chunk,) = DetectionLog(folder, SETTINGS).chunks()
    found, found_appearance = chunk.detections, chunk.appearance
    assert_same(found, detections)
    if appearance is None:
        assert found_appearance is None
    else:
        assert found_appearance.dtype == dtype
        assert found_appearance.tobytes() == appearance.tobytes()


def test_boxes_alone_and_names_as_objects_come_back(tmp_path):
    bare = seen(5).without_keypoints()
    log = DetectionLog(tmp_path, SETTINGS)
    log.append(logged(bare))
    log.append(logged(replace(bare, class_name=bare.class_name.astype(object))))
    for found, appearance in parts(log):
        assert_same(found, bare)
        assert appearance is None


def test_a_resumed_log_equals_an_uninterrupted_one(tmp_path, monkeypatch):
    chunks = [(seen(20 + i, seed=i), seen(20 + i).box_xyxy) for i in range(5)]
    whole = DetectionLog(tmp_path / "a", SETTINGS)
    for chunk in chunks:
        whole.append(logged(*chunk))
    whole.finish()
    folder = tmp_path / "b"
    for killed_after in (0, 2, 2, 3):
        log = DetectionLog(folder, SETTINGS)
        with monkeypatch.context() as patch:
            for i in range(log.complete, 5):
                if i == killed_after:
                    patch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "")))
                    with pytest.raises(OutputError):
                        log.append(logged(*chunks[i]))
                    break
                log.append(logged(*chunks[i]))
        assert not log.finished
        assert DetectionLog(folder, SETTINGS).complete == killed_after
    log = DetectionLog(folder, SETTINGS)
    for i in range(log.complete, 5):
        log.append(logged(*chunks[i]))
    log.finish()
    assert log.finished
    assert DetectionLog(folder, SETTINGS).finished
    assert content(folder) == content(tmp_path / "a")
    for (found, looks), (expected, expected_looks) in zip(parts(log), chunks, strict=True):
        assert_same(found, expected)
        np.testing.assert_array_equal(looks, expected_looks)


def test_a_removed_chunk_and_those_after_it_are_detected_again(tmp_path):
    log = DetectionLog(tmp_path, SETTINGS)
    for chunk in range(4):
        log.append(logged(seen(4, seed=chunk)))
    (tmp_path / "00001.npz").unlink()
    log = DetectionLog(tmp_path, SETTINGS)
    assert log.complete == 1
    log.append(logged(seen(7)))
    assert log.complete == 2
    assert [len(found) for found, _ in parts(log)] == [4, 7]


def test_a_film_without_frames_is_finished(tmp_path):
    DetectionLog(tmp_path, SETTINGS).finish()
    log = DetectionLog(tmp_path, SETTINGS)
    assert log.finished
    assert list(log.chunks()) == []


def test_other_settings_are_refused_by_name(tmp_path):
    DetectionLog(tmp_path, {"any": "other"})  # nothing was detected under these
    DetectionLog(tmp_path, SETTINGS).append(logged(seen(4)))
    DetectionLog(tmp_path, SETTINGS | {"thresholds": [0.1, 0.5]})
    other = {"source": {"name": "a.avi", "size": 13}, "thresholds": [0.1, 0.5], "chunk": 50}
    with pytest.raises(InputError) as told:
        DetectionLog(tmp_path, other)
    text = str(told.value)
    assert "source.size (12 there, 13 now)" in text
    assert 'detector ("yolox" there, nothing now)' in text
    assert "chunk (nothing there, 50 now)" in text
    assert "name" not in text.replace(str(tmp_path), "")
    with pytest.raises(InputError, match=r"thresholds \(\[0.1, 0.5\] there, null now\)"):
        DetectionLog(tmp_path, SETTINGS | {"thresholds": None})


def test_bad_input(tmp_path):
    log = DetectionLog(tmp_path / "log", SETTINGS)
    with pytest.raises(InputError, match="has 3 rows, expected one for each of the 4"):
        log.append(logged(seen(4), np.zeros((3, 2))))
    with pytest.raises(InputError, match="settings: cannot be written as JSON"):
        DetectionLog(tmp_path / "other", {"threshold": float("nan")})
    log.finish()
    with pytest.raises(InputError, match="is finished"):
        log.append(logged(seen(4)))
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        DetectionLog(tmp_path / "file", SETTINGS)


@pytest.mark.parametrize("damage", [lambda b: b[:-200], lambda b: b"", lambda b: b"x" + b[1:]])
def test_a_damaged_chunk_is_named(tmp_path, damage):
    log = DetectionLog(tmp_path, SETTINGS)
    log.append(logged(seen(4)))
    log.append(logged(seen(4)))
    path = tmp_path / "00001.npz"
    path.write_bytes(damage(path.read_bytes()))
    found = log.chunks()
    next(found)
    with pytest.raises(InputError, match=r"00001\.npz: is damaged: .*remove it"):
        next(found)


def test_a_chunk_that_vanished_from_a_finished_log(tmp_path):
    log = DetectionLog(tmp_path, SETTINGS)
    log.append(logged(seen(4)))
    log.finish()
    (tmp_path / "00000.npz").unlink()
    with pytest.raises(InputError, match="says 1 chunks, found 0"):
        DetectionLog(tmp_path, SETTINGS)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("settings.json", "[]"),
        ("settings.json", '{"schema": 7}'),
        ("settings.json", '{"schema": "scene4d/detections/1"}'),
        ("finished.json", "[1]"),
        ("finished.json", '{"chunks": {}}'),
        ("finished.json", "nothing"),
    ],
)
def test_a_log_of_wrong_types_is_bad_input(tmp_path, name, content):
    log = DetectionLog(tmp_path, SETTINGS)
    log.append(logged(seen(4)))
    log.finish()
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError):
        DetectionLog(tmp_path, SETTINGS)


def test_a_log_of_another_version(tmp_path):
    (tmp_path / "settings.json").write_text('{"schema": "scene4d/detections/9"}')
    with pytest.raises(InputError, match="'scene4d/detections/9', expected"):
        DetectionLog(tmp_path, SETTINGS)
