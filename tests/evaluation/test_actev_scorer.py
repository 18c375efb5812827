"""What NIST's scorer is given, and what is said where it is not."""

import subprocess
import sys
from pathlib import Path

from benchmarks.actev_scorer import PROTOCOL, inputs

from actev_rules import faults
from scene4d.core.files import read_json

LINE = (
    "- {{'act': {{'act2': {{'{name}': 1.0}}, 'actors': [{{'id1': 6, 'timespan': [{{'tsr0': [{span}]"
    "}}]}}], 'id2': 2, 'timespan': [{{'tsr0': [{span}]}}]}}}}\n"
)


def test_the_reference_is_what_is_labelled_and_every_clip_is_in_the_index(tmp_path):
    labels = []
    for name, kind in (("a.G328", "vehicle_stops"), ("b.G506", "hand_interacts_with_person")):
        path = tmp_path / f"{name}.activities.yml"
        path.write_text(LINE.format(name=kind, span="30, 89"))
        labels.append(path)
    arguments = inputs(labels, tmp_path / "system.json", tmp_path)
    assert arguments[0] == PROTOCOL
    reference, activities, files = (
        read_json(tmp_path / f"{name}.json")
        for name in ("reference", "activity-index", "file-index")
    )
    assert faults(reference) == []
    assert list(files) == reference["filesProcessed"] == ["a.G328", "b.G506"]
    # What the catalogue does not know is not asked for.
    assert list(activities) == ["vehicle_stops"]
    (one,) = reference["activities"]
    assert one["localization"] == {"a.G328": {"30": 1, "90": 0}}
    assert {Path(value).name for value in arguments if value.endswith(".json")} == {
        "system.json", "reference.json", "activity-index.json", "file-index.json",
    }  # fmt: skip


def test_without_the_scorer_one_sentence_says_so(tmp_path):
    command = [sys.executable, "-m", "benchmarks.actev_scorer", "--scorer", tmp_path / "none.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.count("\n") == 1
    assert "ActEV_Scorer is not here" in done.stdout
