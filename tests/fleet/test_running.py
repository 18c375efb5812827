"""A fleet in one process: whole results, once; what fails; the command."""

import errno
import json
import os
import shutil
import threading
import time
from pathlib import Path

import duckdb
import pytest
from fleet_plans import boxes, plan, results

from scene4d.core.errors import InputError, OutputError
from scene4d.core.progress import Silent
from scene4d.fleet import _stages as stages
from scene4d.fleet import run_fleet
from scene4d.fleet._alone import Lease
from scene4d.fleet._store import Store
from scene4d.fleet._tasks import Result
from scene4d.store.query import Scene


class Shown(Silent):
    """Names of the stages that were shown."""

    def __init__(self) -> None:
        self.stages: list[str] = []

    def stage(self, title, total):
        self.stages.append(title)
        return super().stage(title, total)


@pytest.fixture
def folder(tmp_path) -> Path:
    return boxes(tmp_path)


@pytest.fixture
def counted(monkeypatch) -> list[str]:
    """Tracking that writes one small file; the clips that it was given."""
    given: list[str] = []

    def track(job, store, scratch, out):
        given.append(job.task.clip.name)
        (out / "seen.json").write_text(json.dumps(job.task.clip.read_text()))
        return 360.0

    monkeypatch.setitem(stages._STAGES, "track", track)
    return given


def test_what_is_there_is_not_done_again(folder, counted):
    found = run_fleet(plan(folder), folder / "store").to_dict()
    assert (found["done"], found["earlier"], len(counted)) == (4, 0, 4)
    assert found["footage_h"] == pytest.approx(0.4)
    assert found["cameras"]["gate"]["state"] == "complete"
    again = run_fleet(plan(folder), folder / "store").to_dict()
    assert (again["done"], again["earlier"], len(counted)) == (4, 4, 4)
    # A clip under another name is the same clip; another clip is another.
    (folder / "gate" / "gate-20261120T080000.txt").rename(folder / "gate-20261120T080000.txt")
    (folder / "gate-20261120T080000.txt").rename(folder / "gate" / "gate-20261120T080000.txt")
    (folder / "gate" / "gate-20261120T080200.txt").write_text("more")
    grown = run_fleet(plan(folder), folder / "store").to_dict()
    assert (grown["done"], grown["earlier"], counted[4:]) == (5, 4, ["gate-20261120T080200.txt"])
    assert (
        run_fleet(plan(folder, "workers: {cores: 2}"), folder / "store").to_dict()["earlier"] == 5
    )


@pytest.mark.parametrize("when", ["before", "amid", "after"])
def test_a_killed_fleet_goes_on_and_ends_the_same(folder, counted, monkeypatch, when):
    run_fleet(plan(folder), folder / "quiet")
    put, left = stages.Store.put, [2]

    def killed(self, made, result):
        left[0] -= 1
        if left[0] == 0 and when == "before":
            raise KeyboardInterrupt
        if left[0] == 0 and when == "amid":  # half of it is on its way
            half = folder / "store" / ".half" / "on-its-way-x" / "content" / "result"
            half.mkdir(parents=True)
            (half / "seen.json").write_text("{")
            raise KeyboardInterrupt
        put(self, made, result)
        if left[0] == 0:  # not marked as done
            raise KeyboardInterrupt

    monkeypatch.setattr(stages.Store, "put", killed)
    with pytest.raises(KeyboardInterrupt):
        run_fleet(plan(folder), folder / "store")
    assert len(results(folder / "store")) == 1
    assert json.loads((folder / "store" / "status.json").read_text())["done"] == 1
    assert run_fleet(plan(folder), folder / "store").to_dict()["earlier"] == 1
    assert results(folder / "store") == results(folder / "quiet")
    assert not list((folder / "store").glob(".half/*"))


@pytest.mark.parametrize("what", ["begun", "done", "spoilt"])
def test_workers_of_a_killed_program_and_the_next_one_do_not_undo_each_other(
    folder, tmp_path, monkeypatch, what
):
    store, copied = Store(str(folder / "store")), shutil.copyfile
    store.open()
    result = Result("track", "gate", "0" * 32)
    for name in ("a", "b"):
        (tmp_path / "made").mkdir(exist_ok=True)
        (tmp_path / "made" / name).write_text(name)

    def amid(source, target):
        copied(source, target)
        if source.name == "a" and what != "spoilt":
            monkeypatch.setattr(shutil, "copyfile", copied)
            store.sweep()  # the next program begins
            if what == "begun":
                return
            store.put(tmp_path / "made", result)  # does the same, and marks it
            store.write(f"done/{result.key}", {})
            (folder / "store" / result.path / "read").touch()  # to know it by

    monkeypatch.setattr(shutil, "copyfile", amid)
    if what == "spoilt":  # a machine went down: names came to the disk, content did not
        (folder / "store" / result.path).mkdir(parents=True)
        (folder / "store" / result.path / "a").touch()
    store.put(tmp_path / "made", result)
    there = {one.name: one.read_text() for one in (folder / "store" / result.path).iterdir()}
    assert there == {"a": "a", "b": "b"} | ({"read": ""} if what == "done" else {})
    assert not list((folder / "store").glob(".half/*"))


def test_a_clip_that_fails_is_put_aside_with_its_reason(folder, monkeypatch):
    good, tries = stages._STAGES["track"], []

    def track(job, *rest):
        if job.task.clip.name.startswith("gate") and job.task.begins.minute:
            tries.append(job.task.clip.name)
            raise InputError("the clip is cut short; copy it again")
        if job.task.camera == "yard":
            raise ZeroDivisionError("a defect")
        return good(job, *rest)

    monkeypatch.setitem(stages._STAGES, "track", track)
    asked = plan(folder, "search: {words: [a person walks]}")
    for _ in range(2):  # it is not tried again
        found = run_fleet(asked, folder / "store").to_dict()
        assert [one["reason"] for one in found["quarantine"]][:2] == [
            "the clip is cut short; copy it again", "ZeroDivisionError: a defect",
        ]  # fmt: skip
        # The search of the camera goes on without the clip; that without any clip cannot.
        assert (
            found["cameras"]["gate"]["quarantined"] == 1 and found["cameras"]["gate"]["done"] == 2
        )
        assert found["cameras"]["yard"]["skipped"] == 1
        assert found["cameras"]["yard"]["state"] == "quarantine"
    assert len(tries) == 1
    monkeypatch.setitem(stages._STAGES, "track", good)
    for path in (folder / "store" / "quarantine").glob("*.json"):
        path.unlink()
    assert run_fleet(asked, folder / "store").to_dict()["quarantined"] == 0


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), OutputError("full")])
def test_a_full_disk_ends_the_fleet_and_no_clip_is_to_blame(folder, counted, monkeypatch, error):
    good = stages._STAGES["track"]

    def track(job, *rest):
        if len(counted) == 2:
            raise error
        return good(job, *rest)

    monkeypatch.setitem(stages._STAGES, "track", track)
    with pytest.raises(OutputError, match="full"):
        run_fleet(plan(folder), folder / "store")
    assert not (folder / "store" / "quarantine").exists()
    monkeypatch.setitem(stages._STAGES, "track", good)
    found = run_fleet(plan(folder), folder / "store").to_dict()
    assert (found["done"], found["earlier"]) == (4, 2)


def test_the_command_tracks_searches_and_merges(folder, capsys):
    """The program itself, on boxes; then DuckDB alone on what it left."""
    from typer.testing import CliRunner

    from scene4d.cli.app import app

    square = [[-900, -900], [900, -900], [900, 900], [-900, 900]]
    (folder / "zones.json").write_text(json.dumps({"zones": {"yard": square}}))
    three = "a person walks, person enters vehicle, a person is in zone yard"
    asked = plan(folder, f"search: {{words: [{three}], zones: zones.json}}")
    words = ["fleet", str(asked), "--out", str(folder / "store"), "--json"]
    said = json.loads(CliRunner().invoke(app, words).stdout)
    assert said["error"] is None and said["quarantine"] == []
    walks = said["searches"]["a person walks"]
    assert walks["events"] >= 8  # two people in each of four clips
    assert {one["camera"] for one in walks["best"]} == {"gate", "yard"}
    scores = [(-(one["probability"] or 0), -one["score"]) for one in walks["best"]]
    assert scores == sorted(scores)
    assert said["searches"]["person enters vehicle"]["events"] == 0  # there is no vehicle
    assert said["searches"]["a person is in zone yard"]["events"] >= 8
    assert said["cpu_h_per_camera_hour"] > 0

    clips = sorted((folder / "store" / "track" / "gate").iterdir())
    scene = Scene.open(*clips)
    assert [len(scene.runs), scene.cameras] == [2, ("gate",)]
    rows = duckdb.sql(
        "SELECT camera, count(DISTINCT key) AS clips, count(DISTINCT (key, track)) AS tracks, "
        f"count(*) AS n FROM read_parquet('{folder}/store/track/*/*/tracks/*/*/*.parquet') "
        f"WHERE key IN (SELECT key FROM read_json('{folder}/store/done/*.json')) "
        "GROUP BY camera ORDER BY camera"
    ).fetchall()
    assert [row[:3] for row in rows] == [("gate", 2, 4), ("yard", 2, 4)]
    assert rows[0][3] == len(scene)
    shown = CliRunner().invoke(app, words[:-1]).stdout
    assert "gate    complete" in shown and "a person walks:" in shown

    # A search of what is no scene any more does not find nothing: it says what is to be mended.
    shutil.rmtree(clips[0] / "runs")
    asked = plan(folder, "search: {words: [a person runs]}")
    (aside,) = run_fleet(asked, folder / "store").quarantine
    assert aside["camera"] == "gate"
    assert aside["reason"].startswith(f"{clips[0]}: is no scene, or was spoilt; remove it and ")


def test_a_plan_is_done_again_with_the_clips_that_came_and_not_those_that_are_recorded(
    folder, counted, monkeypatch
):
    new, hour_s = folder / "gate" / "gate-20261120T080900.txt", 3600.0
    for path in folder.glob("*/*.txt"):
        os.utime(path, (path.stat().st_mtime - hour_s,) * 2)
    waits: list[float] = []

    def wait(left_s: float) -> None:
        waits.append(left_s)
        said = json.loads((folder / "store" / "status.json").read_text())
        told = said["done"], said["earlier"], said["recording"], said["cameras"]["gate"]["state"]
        if len(waits) == 1:
            assert told == (4, 0, 0, "complete")
            new.write_text("half")
        elif len(waits) == 2:  # it grows
            assert told == (4, 4, 1, "complete")
            new.write_text("the whole")
            os.utime(new, (new.stat().st_mtime - 61,) * 2)
        else:
            assert told == (5, 4, 0, "complete")
            raise KeyboardInterrupt

    asked = plan(folder, "every_s: 600")
    asked.write_text(asked.read_text().replace("cameras:", "cameras:\n  dark: dark/*.mp4"))
    asked.write_text(asked.read_text().replace("track:", "calibrate: {}\ntrack:"))
    shown = Shown()
    found = run_fleet(asked, folder / "store", wait=wait, progress=shown).to_dict()
    assert shown.stages[1::2] == [
        "Round 1: 4 of 4 done; waiting for the next",
        "Round 2: 4 of 4 done, 1 still recorded; waiting for the next",
        "Round 3: 5 of 5 done; waiting for the next",
    ]
    assert (found["rounds"], len(counted), counted[4]) == (3, 5, new.name)
    assert found["cameras"]["dark"]["state"] == "waiting"  # it has no clips yet
    assert len(waits) == 3 and all(500 < one <= 600 for one in waits)

    # A clip that is removed while a round is under way is left out; a plan that is broken ends it.
    good = stages._STAGES["track"]

    def track(job, *rest):
        new.unlink(missing_ok=True)
        return good(job, *rest)

    monkeypatch.setitem(stages._STAGES, "track", track)
    again = folder / "again"
    with pytest.raises(InputError, match="unknown field 'more'"):
        run_fleet(asked, again, wait=lambda _: plan(folder, "more: 1") and None)
    said = json.loads((again / "status.json").read_text())
    assert (said["done"], said["skipped"], said["running"]) == (4, 1, 0)


@pytest.mark.parametrize("where", ["folder", "memory://rounds/fleet"])
def test_of_sites_that_rounds_made_the_last_two_stay(folder, counted, monkeypatch, where):
    monkeypatch.setitem(stages._STAGES, "align", lambda job, _, __, out: _site(job, out))
    where = str(folder / "store") if where == "folder" else where
    hour_s, there = 3600.0, []
    for path in folder.glob("*/*.txt"):
        os.utime(path, (path.stat().st_mtime - hour_s,) * 2)

    def sites() -> list[str]:
        store = Store(where)
        said = [store.read(f"done/{key}") for key in store.keys("done")]
        paths = [one["path"] for one in said if one["stage"] == "align"]
        kept = [store._fs.cat_file(f"{store._root}/{path}/site.json") for path in paths]
        assert len(store._fs.ls(f"{store._root}/align/site", detail=False)) == len(kept)
        return sorted(kept, key=int)

    def wait(_: float) -> None:
        there.append(sites())
        if len(there) == 4:
            raise KeyboardInterrupt
        if len(there) < 3:  # no clip comes to the last round
            more = folder / "gate" / f"gate-20261120T09{len(there):02d}00.txt"
            more.write_text(f"more {len(there)}")
            os.utime(more, (more.stat().st_mtime - hour_s,) * 2)

    asked = plan(folder, "align: {}", "every_s: 600")
    run_fleet(asked, where, wait=wait)
    assert there == [[b"4"], [b"4", b"5"], [b"5", b"6"], [b"6"]]
    (folder / "gate" / "gate-20261120T090100.txt").unlink()
    run_fleet(plan(folder, "align: {}"), where)  # another program's
    assert sites() == [b"5", b"6"]


def _site(job, out: Path) -> float:
    (out / "site.json").write_text(str(len(job.needs)))
    return 0.0


@pytest.mark.parametrize("where", ["folder", "memory://city/fleet"])
def test_one_fleet_works_on_a_store_at_a_time(folder, where):
    where = str(folder / "store") if where == "folder" else where
    refused = []

    def work(job, address):
        with pytest.raises(InputError, match=f"{where}: another fleet works on this store.*; wait"):
            run_fleet(plan(folder), where)
        refused.append(job)
        raise KeyboardInterrupt

    for number in (1, 2):  # the first one has ended
        with pytest.raises(KeyboardInterrupt):
            run_fleet(plan(folder), where, work=work)
        assert len(refused) == number
    assert Store(where).read("lease") is None


def test_a_lease_that_nobody_renews_is_nobodys_and_one_that_is_lost_ends_the_fleet():
    store = Store("memory://leased/fleet")
    other = {"owner": "somebody", "host": "north", "pid": 7}
    store.write("lease", other | {"renewed_s": time.time() - 50})
    with pytest.raises(InputError, match=r"process 7 on north, 50 s ago; .*after 60 s\); wait"):
        Lease(store).take()
    store.write("lease", other | {"renewed_s": time.time() - 70})  # it was killed
    mine = Lease(store)
    mine.take()
    mine.check()
    store.write("lease", other | {"renewed_s": time.time()})
    mine.keep(AtOnce())
    with pytest.raises(OutputError, match="another fleet"):
        mine.check()
    mine.release()
    assert store.read("lease")["owner"] == "somebody"


class AtOnce(threading.Event):
    """Time passes at once."""

    def wait(self, timeout=None):
        return False
