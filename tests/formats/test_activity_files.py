"""Labelled activities in (KPF) and found ones out (ActEV JSON)."""

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actev_rules import faults
from scene4d.core.errors import InputError
from scene4d.formats.activities import ActevInstance, LabelledActivity, actev_json, read_activities

LINE = (
    "- {'act': {'act2': {'person_enters_vehicle': 1.0}, 'actors': [{'id1': 6, 'timespan': "
    "[{'tsr0': [3284, 3300]}]}, {'id1': 5, 'timespan': [{'tsr0': [3290, 3312]}]}], 'id2': 2, "
    "'src_status': 'good', 'timespan': [{'tsr0': [3284, 3312]}]}}"
)
SAME = LabelledActivity("person_enters_vehicle", 3284, 3312, (6, 5))


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "clip.activities.yml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "line",
    [
        LINE,
        LINE.replace("'", '"'),
        LINE.replace("'", ""),
        # The order of the keys is free.
        "- {act: {timespan: [{tsr0: [3284, 3312]}], actors: [{id1: 6, timespan: [{tsr0: [3284, "
        "3300]}]}, {id1: 5, timespan: [{tsr0: [3290, 3312]}]}], act2: {a: 0.1, "
        "person_enters_vehicle: 0.9}}}",
        # Two spans are one activity from the first frame to the last.
        LINE[:-2].replace("'timespan': [{'tsr0': [3284, 3312]}]", "")
        + "'timespan': [{'tsr0': [3284, 3290]}, {'tsr0': [3300, 3312]}]}}",
    ],
)
def test_every_way_to_write_an_activity(tmp_path, line):
    assert read_activities(written(tmp_path, f"---\n# comment\n\n{line}\n")) == (SAME,)


def test_a_clip_where_nothing_happened(tmp_path):
    assert read_activities(written(tmp_path, "- {'meta': 'was marked empty'}\n")) == ()


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (LINE[:-1], "line 2: expected one KPF packet"),
        ("hello", "line 2: expected one KPF packet"),
        ("- {'act': [1]}", "line 2: field 'act'"),
        (LINE.replace("'act2': {'person_enters_vehicle': 1.0}, ", ""), "line 2: field 'act.act2'"),
        (LINE.replace("1.0", "'often'"), "line 2: field 'act.act2.person_enters_vehicle'"),
        (LINE.replace("3284, 3312", "3312, 3284"), "line 2: field 'act.timespan'"),
        (LINE.replace("3284, 3312", "-4, 3312"), "line 2: field 'act.timespan'"),
        (LINE.replace("3284, 3312", "3284.5, 3312"), "line 2: field 'act.timespan'"),
        (LINE.replace("'timespan'", "'span'"), "line 2: field 'act.timespan'"),
        (LINE.replace("'id1': 6", "'id1': 'six'"), "line 2: field 'act.actors[0].id1'"),
        (LINE.replace("'id1': 6", "'id': 6"), "line 2: field 'act.actors[0].id1'"),
        (re.sub(r"'actors': .*'id2'", "'actors': 7, 'id2'", LINE), "line 2: field 'act.actors'"),
    ],
)
def test_a_broken_line_is_named(tmp_path, broken, said):
    path = written(tmp_path, f"{LINE}\n{broken}\n")
    with pytest.raises(InputError) as raised:
        read_activities(path)
    assert str(raised.value).startswith(f"{path}: {said}")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"none\.activities\.yml: cannot be read"):
        read_activities(tmp_path / "none.activities.yml")


@given(st.text(alphabet="- {}[]':act2idtsr0,\n&*!|>1.", max_size=80))
def test_garbage_is_bad_input_and_nothing_else(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("garbage") / "clip.activities.yml"
    path.write_text(text)
    try:
        read_activities(path)
    except InputError as error:
        assert str(path) in str(error)


def test_the_real_labels(shared_data, tmp_path):
    """Numbers of the data's own description: 96 clips, about 125 enter and 170 leave vehicles."""
    import tarfile

    with tarfile.open(shared_data / "meva" / "annotations.tar.xz") as archive:
        names = [name for name in archive.getnames() if name.endswith(".activities.yml")]
        archive.extractall(tmp_path, names, filter="data")
    labels = [one.name for name in names for one in read_activities(tmp_path / name)]
    assert len(names) == 96
    assert labels.count("person_enters_vehicle") == 125
    assert labels.count("person_exits_vehicle") == 169


def signal(instance: dict) -> tuple[str, dict[int, int]]:
    ((file, values),) = instance["localization"].items()
    return file, {int(frame): value for frame, value in values.items()}


def scored(*instances: ActevInstance, files=("a.avi", "b.avi")) -> dict:
    return json.loads(json.dumps(actev_json(instances, files), allow_nan=False))


GOOD = scored(
    ActevInstance("vehicle_stops", "a.avi", 30, 89, 0.7),
    ActevInstance("person_enters_vehicle", "a.avi", 5, 5, 1e-9),
)


def test_what_the_scorer_reads():
    assert faults(GOOD) == []
    assert GOOD["filesProcessed"] == ["a.avi", "b.avi"]
    done = {"status": "success", "message": ""}
    assert GOOD["processingReport"] == {"fileStatuses": {"a.avi": done, "b.avi": done}}
    assert [one["activityID"] for one in GOOD["activities"]] == [1, 2]
    # The signal is 1 on every frame of the event and on no other.
    assert signal(GOOD["activities"][0])[1] == {30: 1, 90: 0}
    assert signal(GOOD["activities"][1])[1] == {5: 1, 6: 0}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v: v.pop("processingReport"), "statuses"),
        (lambda v: v["filesProcessed"].pop(), "statuses"),
        (lambda v: v["filesProcessed"].append("c d.avi"), "file 'c d.avi'"),
        (lambda v: v["activities"][0].pop("presenceConf"), "presenceConf"),
        (lambda v: v["activities"][0].update(activityID=2), "twice"),
        (lambda v: v["activities"][0]["localization"].update({"b.avi": {"1": 1, "2": 0}}), "one"),
        (lambda v: v["activities"][0].update(localization={"c.avi": {"1": 1, "2": 0}}), "not proc"),
        (lambda v: v["activities"][0].update(localization={"a.avi": {"1": 1}}), "frames"),
        (lambda v: v["activities"][0].update(localization={"a.avi": {"1": 0, "2": 1}}), "signal"),
    ],
)
def test_the_rules_see_what_breaks_them(change, said):
    broken = json.loads(json.dumps(GOOD))
    change(broken)
    assert any(said in fault for fault in faults(broken))


def test_nothing_found_is_a_result():
    assert actev_json([], ["a.avi"]) == {
        "filesProcessed": ["a.avi"],
        "processingReport": {"fileStatuses": {"a.avi": {"status": "success", "message": ""}}},
        "activities": [],
    }
