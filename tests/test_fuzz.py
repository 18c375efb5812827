"""Spoilt files end in a reading or in a short error, never in another exception."""

import random
import time
import tracemalloc

import pytest

from fuzz_texts import ANNOTATIONS, K
from fuzzing import SAMPLES, misread, spoilt, write_video
from scene4d.core.errors import InputError
from scene4d.formats.activities import read_activities
from scene4d.formats.annotations import annotation_formats
from scene4d.formats.cameras import camera_formats, read_camera
from scene4d.video.reader import open_source

SLOW = ("scene", "site", "video", "picture")
"""A read takes milliseconds: fewer of these."""


@pytest.mark.filterwarnings("ignore:.*either way", "ignore:.*left out")
@pytest.mark.parametrize("name", SAMPLES)
def test_a_spoilt_file_is_read_or_refused(tmp_path, name):
    """The unspoilt one is read."""
    sample = SAMPLES[name]
    path = sample.make(tmp_path)
    good = path.read_bytes()
    sample.read(path)
    rng = random.Random(name)
    for _ in range(10 if name.startswith(SLOW) else 50):
        path.write_bytes(spoilt(good, rng))
        fault = misread(sample.read, path)
        if isinstance(fault, Exception):
            raise fault
        assert fault is None


def test_a_video_may_have_a_title_in_any_encoding(tmp_path):
    path = tmp_path / "a.mkv"
    write_video(path, "mpeg4", title="Caf#")
    path.write_bytes(path.read_bytes().replace(b"Caf#", b"Caf\xe9"))
    with open_source(path) as source:
        assert source.frame_count == 12


def test_every_format_is_here():
    names = {name.partition(" ")[2] for name in SAMPLES if name.startswith("camera ")}
    assert {known.name for known in camera_formats()} - {"colmap"} <= names
    assert set(ANNOTATIONS) == {known.name for known in annotation_formats()}


def bomb(levels):
    """Nine nested lists of nine aliases each: 10 lines that stand for 9 ** 9 values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (bomb(9) + f"image_width: *a8\nimage_height: 480\ncamera_matrix: [{K}]\n", "aliases"),
        (f"<<: {{image_width: 640}}\nimage_height: 480\ncamera_matrix: [{K}]\n", "merge keys"),
        (f"camera_matrix: [{K}]\nx: [{'1, ' * 1_400_000}1]\n", "characters of YAML"),
    ],
)
def test_yaml_that_grows_is_refused(tmp_path, text, message):
    path = tmp_path / "camera.yml"
    path.write_text(text)
    tracemalloc.start()
    start = time.perf_counter()
    with pytest.raises(InputError, match=message) as caught:
        read_camera(path, format="opencv-yaml")
    assert time.perf_counter() - start < 5
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert len(str(caught.value)) < 500


def test_activities_with_aliases_are_refused(tmp_path):
    path = tmp_path / "clip.activities.yml"
    path.write_text("- {'act': {'act2': &a [1], 'timespan': *a}}\n")
    with pytest.raises(InputError, match="line 1: expected one KPF packet"):
        read_activities(path)
