"""Plans: what is read, what is refused and how, and which tasks they make."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml
from fleet_plans import boxes, plan
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.fleet._plan import read_plan
from scene4d.fleet._tasks import Line, Result, key_of, tasks_of
from strategies import ANY_TEXT


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return boxes(tmp_path_factory.mktemp("clips"))


def test_a_plan_is_tasks_in_the_order_of_their_needs(folder):
    found = read_plan(plan(folder, "align: {}", "search: {words: [a person walks]}"))
    assert found.cameras[0].begins(found.cameras[0].clips[1]) == datetime(
        2026, 11, 20, 8, 1, tzinfo=UTC
    )
    assert (found.track.rate_hz, found.workers.attempts) == (5.0, 3)
    tasks = tasks_of(found)
    assert [(t.stage, t.camera, t.needs) for t in tasks] == [
        *(("track", camera, ()) for camera in ("gate", "gate", "yard", "yard")),
        ("align", "site", (0, 1, 2, 3)),
        ("search", "gate", (0, 1)),
        ("search", "yard", (2, 3)),
    ]


def test_a_camera_without_a_file_is_calibrated_from_its_first_clip(folder):
    text = "cameras: {gate: {boxes: gate/*.txt}}\ncalibrate: {image_size: [640, 480]}\ntrack: {}"
    (folder / "found.yaml").write_text(text)
    tasks = tasks_of(read_plan(folder / "found.yaml"))
    assert [(t.stage, t.clip.stem[-2:], t.needs) for t in tasks] == [
        ("calibrate", "00", ()), ("track", "00", (0,)), ("track", "00", (0,)),
    ]  # fmt: skip
    assert tasks[0].clip == tasks[1].clip != tasks[2].clip
    line = Line(tasks)
    assert line.next() == 0 and line.next() is None
    line.ended(0, None)  # the camera is undetermined
    assert (line.next(), line.next(), line.next()) == (1, 2, None)
    assert line.lacks(1) and line.lacks(2) and not line.lacks(0)


def test_a_folder_of_clips_is_a_plan(tmp_path):
    for name in ("hall/b.mp4", "hall/a.MP4", "yard/c.avi", "yard/camera.json", "docs/read.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    hall, yard = read_plan(tmp_path).cameras
    assert [clip.name for clip in hall.clips] == ["a.MP4", "b.mp4"]
    assert (hall.camera, yard.camera) == (None, tmp_path / "yard" / "camera.json")
    with pytest.raises(InputError, match=r"docs: holds no clips .*\.avi"):
        read_plan(tmp_path / "docs")


def test_a_key_follows_from_content_stage_options_and_needs(folder):
    task = tasks_of(read_plan(plan(folder)))[0]
    faster = tasks_of(read_plan(plan(folder, "workers: {cores: 2}")))[0]
    key = key_of(task, "ab", ())
    assert key_of(faster, "ab", ()) == key
    (folder / "plan.yaml").write_text(
        (folder / "plan.yaml").read_text().replace("rate_hz: 5", "rate_hz: 4")
    )
    other = tasks_of(read_plan(folder / "plan.yaml"))[0]
    camera = task.calibration.read_bytes()
    keys = [key, key_of(other, "ab", ()), key_of(task, "ac", ())]
    keys.append(key_of(task, "ab", (Result("calibrate", "gate", "0"),)))
    task.calibration.write_bytes(camera + b" ")
    keys.append(key_of(task, "ab", ()))
    task.calibration.write_bytes(camera)
    assert len(set(keys)) == 5


REFUSED = {
    "": "is empty",
    "cameras: [": "line [12]: is not valid YAML",
    "a: &a [1]\nb: *a": r"line 1: aliases \(\*\) are not read",
    "cameras: {g: nowhere.mp4}": "field 'cameras.g' must be files that are there",
    "cameras: {g: 3}": "field 'cameras.g' must be an object, found 3",
    "cameras: {g: {}}": "field 'cameras.g.footage' is missing: it must be given, or boxes",
    "cameras: {g: c/*.txt}": "nothing is to be done; add one of calibrate, track",
    "cameras: {g: c/*.txt}\ntrack: {}": "cameras.g.camera' is missing; give the camera's",
    "cameras: {g: c/*.txt}\nsearch: {words: [a person walks]}": "'search' needs tracks",
    "cameras: {g: c/*.txt}\ncamera: {}": "unknown field 'camera'; known: cameras, calibrate",
    "cameras: {g: c/*.txt, g: b}": "line 1: the name 'g' is there twice",
    "cameras: {g: c/*.txt, G: c/*.txt}\ncalibrate: {}": "differ in case alone",
    "cameras: {g: c/*.txt}\ntrack: {rate: 5}": "unknown field 'track.rate'; known: rate_hz",
    "cameras: {g: c/*.txt}\ntrack: {rate_hz: fast}": "'track.rate_hz' must be a number",
    "cameras: {g: c/*.txt}\ntrack: {rate_hz: -5}": "field 'track': rate_hz: found -5",
    "cameras: {g: {footage: c/*.txt, start: '%Y'}}\ntrack: {}": "does not say when the clip",
    "cameras: {g: c/*.txt}\ntrack: {}\nsearch: {words: [zxcv]}": "field 'search.words': ",
    "cameras: {g: c/*.txt}\ntrack: {}\nevery_s: 10m": "'every_s' must be a number, at least 1",
    "cameras: {g: c/*.txt}\ntrack: {}\nevery_s: .nan": "'every_s' must be a number",
    "cameras: {g: c/*.txt}\ntrack: {}\nworkers: {cores: 0}": "field 'workers': cores: found 0",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_bad_plan_is_refused_with_file_field_and_remedy(folder, text):
    path = folder / "bad.yaml"
    path.write_text(text.replace("c/*.txt", "gate/*.txt"))
    with pytest.raises(InputError, match=REFUSED[text]) as caught:
        read_plan(path)
    assert "bad.yaml" in str(caught.value) or "cameras.g.start" in str(caught.value)


ODD = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(ANY_TEXT, max_size=8)
    | st.dates(),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(ANY_TEXT, max_size=5), inner)
    ),
    max_leaves=8,
)
NAMES = st.sampled_from(["cameras", "track", "calibrate", "search", "align", "workers", "gate"])
INSIDE = st.sampled_from(["rate_hz", "fps", "camera", "footage", "start", "words", "image_size"])
PLANS = st.dictionaries(NAMES, ODD | st.dictionaries(INSIDE | NAMES, ODD, max_size=3), max_size=4)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(said=PLANS | ODD, spoilt=st.integers(0, 400))
def test_whatever_stands_in_a_plan_it_is_read_or_refused(tmp_path, said, spoilt):
    path = tmp_path / "plan.yaml"
    text = yaml.safe_dump(said)
    path.write_bytes((text[:spoilt] + text[spoilt + 1 :]).encode("utf-8", "replace"))
    try:
        read_plan(path)
    except InputError as error:
        assert str(error).startswith(str(path))
