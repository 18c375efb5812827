"""What is said of cameras that are watched, were watched, and never were."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from finding_scenes import people, write_scene
from scene4d.app._fleet import fleet_of
from scene4d.app._opened import Opened
from scene4d.core.errors import InputError
from scene4d.store.status import Status, status_path

LIVE = Status("gate", "r", "live", None, 0.4, 200, 30, 1, datetime(2026, 11, 20, tzinfo=UTC))


@pytest.fixture
def scene(tmp_path):
    folder = write_scene(tmp_path / "scene", people())
    (folder / "status").mkdir()
    return folder


@pytest.mark.parametrize(
    ("change", "age_s", "state", "for_s"),
    [
        ({}, 1, "live", None),
        ({"behind_s": 14.2}, 1, "behind", 14),
        ({"behind_s": 14.2}, 60, "silent", 60),
        ({"state": "moved"}, 1, "moved", None),
        ({"state": "lost"}, 1, "lost", None),
        ({"state": "refused", "reason": "too few people"}, 100, "refused", None),
        ({"state": "calibrating"}, 400, "silent", 400),
        ({"state": "ended"}, 1e6, "ended", None),
    ],
)
def test_what_a_watched_camera_does(scene, change, age_s, state, for_s):
    written = datetime.now(UTC) - timedelta(seconds=age_s)
    replace(LIVE, written=written, **change).save(scene)
    (said,) = fleet_of(Opened([scene]), [scene])
    assert (said["state"], said["reason"]) == (state, change.get("reason"))
    assert said["dropped"] == 0.15
    assert (for_s is None) == ("for_s" not in said)
    assert for_s is None or for_s <= said["for_s"] <= for_s + 5


def test_a_recorded_camera_has_no_status_and_a_wrong_one_is_named(scene):
    (said,) = fleet_of(Opened([scene]), [scene])
    assert said == {"camera": "gate", "pictured": None, "state": "recorded", "reason": None}
    LIVE.save(scene)
    path = status_path(scene, "gate")
    whole = json.loads(path.read_text())
    for name, value in (("state", "asleep"), ("written", "noon"), ("behind_s", -1), ("run", 3)):
        path.write_text(json.dumps(whole | {name: value}))
        with pytest.raises(InputError, match=f"gate.json: field '{name}'"):
            fleet_of(Opened([scene]), [scene])
