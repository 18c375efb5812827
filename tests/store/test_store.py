"""Scenes on disk: what is written comes back, and a kill at any moment leaves a whole scene."""

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from stored_scenes import (
    CAMERA,
    assert_same,
    drawn,
    in_order,
    store,
    walk,
    width,
    writer,
)

from scene4d.core.errors import InputError, OutputError
from scene4d.store.query import Scene
from scene4d.store.runs import complete_runs, file_name
from scene4d.store.schema import COLUMNS, RUN_TRACKS, SCENE_SCHEMA, from_table, to_table

BEYOND = """
import sys
from stored_scenes import walk, writer
out = writer(sys.argv[1], run=sys.argv[2], camera=sys.argv[3])
out.write(walk(100))
print("ready", flush=True)
sys.stdin.readline()
out.close()
"""


def parts(folder):
    return sorted(folder.glob("tracks/camera=*/day=*/*.parquet"))


def files(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def table(folder, run="r"):
    """The rows of one run as its manifest has them, by pyarrow alone."""
    manifest = json.loads((folder / "runs" / f"{run}.json").read_text())
    tables = [pq.ParquetFile(folder / part["path"]).read() for part in manifest["parts"]]
    return pa.concat_tables(tables, promote_options="default")


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_every_value_comes_back(tmp_path_factory, data):
    n, k = data.draw(st.integers(1, 20)), data.draw(st.integers(0, 3))
    number = st.floats(-1e6, 1e6) | st.just(float("nan"))
    tracks = drawn(
        n,
        k,
        data.draw(hnp.arrays(np.float64, (n, width(k)), elements=number)),
        data.draw(hnp.arrays(np.int64, (n, 3), elements=st.integers(0, RUN_TRACKS - 1))),
        data.draw(hnp.arrays(np.bool_, n)),
    )
    # Rows of one track and time have no order of their own.
    tracks = tracks.select(np.unique(tracks.track, return_index=True)[1])
    folder = store(tmp_path_factory.mktemp("s") / "s", tracks, rows_per_part=7)
    found = Scene.open(folder).tracks()
    if np.isnan(tracks.keypoint_uv).all():
        k = found.keypoint_uv.shape[1]
        tracks = _bare(tracks)
        assert k == 0
    assert_same(found, in_order(tracks))


def _bare(tracks):
    n = len(tracks)
    return replace(tracks, keypoint_uv=np.empty((n, 0, 2)), keypoint_score=np.empty((n, 0)))


def test_an_empty_table_comes_back():
    empty = walk(5).select(np.zeros(0, int))
    found = from_table(to_table(empty, camera="c", start_ns=0, track_base=0))
    assert_same(found, _bare(empty))


def test_infinite_values_are_no_nulls(tmp_path):
    tracks = walk(10)
    tracks.covariance_m2[3] = np.inf
    found = table(store(tmp_path, tracks))
    assert found["var_xx"].null_count == 0
    assert np.isinf(found["var_xx"].to_numpy()).sum() == 1


def test_the_columns_are_those_of_the_schema(tmp_path):
    found = table(store(tmp_path, walk(100))).schema
    assert found.names == [column.name for column in COLUMNS]
    names = {
        "float64": "double",
        "dictionary<int32, string>": "dictionary<values=string, indices=int32, ordered=0>",
        "list<float32>": "list<element: float>",
        "timestamp[ns, UTC]": "timestamp[ns, tz=UTC]",
    }
    for column in COLUMNS:
        assert str(found.field(column.name).type) == names.get(column.type, column.type)


def test_unknown_is_null_and_never_nan(tmp_path):
    tracks = walk(200)
    found = table(store(tmp_path, tracks))
    for column in COLUMNS:
        values = found[column.name]
        assert column.nullable or not values.null_count
        if column.type == "float64":
            assert not pa.compute.any(pa.compute.is_nan(values)).as_py()
    assert found["x1"].null_count == np.isnan(tracks.box_xyxy[:, 0]).sum()
    assert found["keypoint_u"].null_count >= (tracks.class_name == "car").sum()
    assert found["keypoint_u"].null_count < len(tracks)


def test_time_is_utc_to_the_nanosecond(tmp_path):
    tracks = walk(50)
    found = table(store(tmp_path, tracks))
    ns = found["time"].cast(pa.int64()).to_numpy()
    noon = np.datetime64("2009-06-01T12:00:00", "ns").astype(np.int64)
    np.testing.assert_array_equal(ns - noon, np.rint(found["time_s"].to_numpy() * 1e9))


def test_without_a_start_time_counts_from_1970(tmp_path):
    folder = store(tmp_path, walk(50), start_utc=None)
    manifest = json.loads((folder / "runs/r.json").read_text())
    assert manifest["start_known"] is False
    assert manifest["begin"].startswith("1970-01-01T00:00:00.0")
    assert [p.parent.name for p in parts(folder)] == ["day=1970-01-01"] * 2


def test_parts_are_bounded_sorted_and_of_one_day(tmp_path):
    midnight_s = 12 * 3600
    tracks = walk(500, start_s=midnight_s - 3)
    folder = store(tmp_path, tracks, rows_per_part=90)
    days = set()
    for path in parts(folder):
        rows = pq.ParquetFile(path).read()
        assert rows.num_rows <= 90
        assert (np.diff(rows["time_s"].to_numpy()) >= 0).all()
        day = path.parent.name.removeprefix("day=")
        days.add(day)
        found = rows["time"].to_numpy().astype("datetime64[D]").astype(str)
        assert (found == day).all()
    assert days == {"2009-06-01", "2009-06-02"}
    assert table(folder).num_rows == 500


def test_files_do_not_depend_on_how_rows_are_handed_over(tmp_path):
    tracks = walk(300)
    whole = store(tmp_path / "a", tracks)
    pieces = tmp_path / "b"
    with writer(pieces) as out:
        for begin, end in ((0, 1), (1, 1), (1, 130), (130, 131), (131, 300)):
            out.write(tracks.select(np.arange(begin, end)))
    assert files(whole) == files(pieces)
    for a, b in zip(parts(whole), parts(pieces), strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_rows_without_a_skeleton_go_beside_rows_with_one(tmp_path):
    people, cars = walk(60, keypoints=3), walk(60, keypoints=0, seed=1)
    with writer(tmp_path, rows_per_part=1000) as out:
        out.write(cars)
        out.write(people)
    lengths = pa.compute.list_value_length(table(tmp_path)["keypoint_u"]).to_pylist()
    assert set(lengths) == {None, 3}


def test_the_manifest_says_what_is_there(tmp_path):
    tracks = walk(100)
    folder = store(tmp_path, tracks)
    manifest = json.loads((folder / "runs/r.json").read_text())
    assert manifest["schema"] == SCENE_SCHEMA
    assert manifest["rows"] == 100 == sum(part["rows"] for part in manifest["parts"])
    assert manifest["classes"]["car"] == (tracks.class_name == "car").sum()
    assert manifest["provenance"] == {"weights": {"yolox": "326524"}}
    assert manifest["software"].startswith("scene4d ")
    assert [folder / part["path"] for part in manifest["parts"]] == parts(folder)
    assert all(
        (folder / part["path"]).stat().st_size == part["bytes"] for part in manifest["parts"]
    )
    assert json.loads((folder / "cameras/c.json").read_text()) == CAMERA
    assert files(folder) == sorted(
        ["cameras/c.json", "runs/.lock", "runs/r.json"]
        + [part["path"] for part in manifest["parts"]]
    )


def test_a_run_without_rows_is_complete(tmp_path):
    with writer(tmp_path):
        pass
    assert [run.rows for run in complete_runs(tmp_path)] == [0]


# Killed


class Killed(BaseException):
    """Passes whatever would tidy up, as a kill does."""


def die(out):
    if out._claim is not None:
        out._claim.lock.release()  # the operating system does this


def kill_at(step, monkeypatch):
    """From now on the process is dead at its n-th change of names."""
    count = iter(range(step))
    for name in ("replace", "unlink"):
        real = getattr(os, name)

        def change(*args, real=real, **options):
            if next(count, None) is None:
                raise Killed
            return real(*args, **options)

        monkeypatch.setattr(os, name, change)


@pytest.mark.parametrize("standing", [False, True])
def test_killed_anywhere_the_scene_is_the_old_one_or_the_new(tmp_path, monkeypatch, standing):
    old, new = walk(90, seed=1), walk(130, seed=2)
    uninterrupted = table(store(tmp_path / "new", new, rows_per_part=70))
    before = table(store(tmp_path / "old", old, rows_per_part=70))
    seen = set()
    for step in range(100):
        folder = tmp_path / f"s{step}"
        if standing:
            shutil.copytree(tmp_path / "old", folder)
        out = None
        with monkeypatch.context() as patch:
            kill_at(step, patch)
            try:
                out = writer(folder, rows_per_part=70)
                out.write(new)
                out.close()
                killed = False
            except Killed:
                killed = True
        if out is not None:
            die(out)
        runs = complete_runs(folder)
        if runs:
            found = table(folder)
            assert found.equals(uninterrupted) or (standing and found.equals(before))
            seen.add(found.equals(uninterrupted))
        else:
            assert not standing
            seen.add(None)
        store(folder, new, rows_per_part=70)
        assert table(folder).equals(uninterrupted)
        named = {part.path for part in complete_runs(folder)[0].parts}
        assert {p.relative_to(folder).as_posix() for p in parts(folder)} == named
        assert not [name for name in files(folder) if name.startswith("runs/.r")]
        if not killed:
            break
    assert step > 8
    assert seen == ({False, True} if standing else {None, True})


def test_an_exception_leaves_the_scene_as_it_was(tmp_path):
    store(tmp_path, walk(90))
    before = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}
    with pytest.raises(ZeroDivisionError), writer(tmp_path) as out:
        out.write(walk(200, seed=1))
        assert list((tmp_path / "runs/.r").iterdir())
        1 / 0  # noqa: B018
    after = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}
    assert set(after) - set(before) == {"runs/.r.claim", "runs/.r.lock"}
    assert {name: after[name] for name in before} == before


def test_a_full_disk_at_the_end_is_told_and_the_scene_stays(tmp_path, monkeypatch):
    store(tmp_path, walk(90))
    before = table(tmp_path)
    out = writer(tmp_path)
    out.write(walk(200, seed=1))

    def full(*_args, **_options):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(OutputError, match="No space left"):
        patch.setattr(os, "replace", full)
        out.close()
    assert table(tmp_path).equals(before)
    store(tmp_path, walk(200, seed=1))


@pytest.mark.parametrize("step", range(12))
def test_a_killed_stream_keeps_what_was_committed(tmp_path, monkeypatch, step):
    first, second = walk(90, seed=1), walk(60, seed=2, start_s=100.0)
    with monkeypatch.context() as patch:
        out = writer(tmp_path, rows_per_part=70)
        out.write(first)
        out.commit()
        committed = table(tmp_path)
        assert committed.num_rows == 90
        kill_at(step, patch)
        try:
            out.write(second)
            out.commit()
        except Killed:
            assert table(tmp_path).num_rows in (90, 150)
        else:
            assert table(tmp_path).num_rows == 150
    die(out)
    assert table(tmp_path).num_rows in (90, 150)


def test_a_committed_run_ends_as_one_that_was_written_at_once(tmp_path):
    tracks = walk(300)
    with writer(tmp_path / "a", rows_per_part=70) as out:
        for begin in range(0, 300, 20):
            out.write(tracks.select(np.arange(begin, begin + 20)))
            out.commit()
            assert len(parts(tmp_path / "a")) <= 5
            assert len(Scene.open(tmp_path / "a")) == begin + 20
    whole = table(store(tmp_path / "b", tracks, rows_per_part=70))
    assert table(tmp_path / "a").equals(whole)
    (run,) = complete_runs(tmp_path / "a")
    assert run.classes == complete_runs(tmp_path / "b")[0].classes
    assert not list((tmp_path / "a/runs").glob(".r*"))


STREAM = """
import sys
from stored_scenes import walk, writer
out = writer(sys.argv[1], run="stream")
out._live = True
for seed in range(3):
    out.write(walk(30, seed=seed, start_s=100.0 * seed))
    out.commit(walk(9, seed=9, start_s=1000.0 * seed))
out._stage_all([walk(9)])
print("ready", flush=True)
sys.stdin.readline()
"""


def test_the_next_writer_clears_away_what_a_killed_stream_left(tmp_path):
    """Of the two, only what the manifest names: another process was killed while it wrote."""
    with subprocess.Popen(
        [sys.executable, "-c", STREAM, str(tmp_path)],
        cwd=Path(__file__).parent,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as stream:
        assert stream.stdout.readline() == "ready\n"
        stream.kill()
    left, published = files(tmp_path), table(tmp_path, "stream")
    assert [name for name in left if name.startswith("runs/.stream/")]
    store(tmp_path, walk(60))
    found, (first, _) = files(tmp_path), complete_runs(tmp_path)
    assert [name for name in found if "stream" in name] == [
        "runs/stream.json",
        *sorted(part.path for part in first.parts),
    ]
    assert len([name for name in left if name.endswith(".parquet")]) > 2 * len(first.parts)
    assert table(tmp_path, "stream").equals(published)


def test_a_killed_first_attempt_keeps_its_numbers_and_nothing_else(tmp_path):
    out = writer(tmp_path)
    out.write(walk(100))
    die(out)
    store(tmp_path, walk(50), run="q")
    assert not list(tmp_path.glob("runs/.r/*"))
    store(tmp_path, walk(100))
    assert [run.run for run in complete_runs(tmp_path)] == ["r", "q"]


def test_an_exception_leaves_what_was_committed(tmp_path):
    with pytest.raises(ZeroDivisionError), writer(tmp_path) as out:
        out.write(walk(90))
        out.commit()
        out.write(walk(50, seed=1))
        1 / 0  # noqa: B018
    assert table(tmp_path).num_rows == 90


# Beside each other


def beyond(folder, run, camera="c"):
    return subprocess.Popen(
        [sys.executable, "-c", BEYOND, str(folder), run, camera],
        cwd=Path(__file__).parent,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_one_run_has_one_writer_until_that_is_dead(tmp_path):
    with beyond(tmp_path, "r") as other:
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(InputError, match=f"'r' is being written by process {other.pid}"):
            writer(tmp_path)
        with pytest.raises(InputError, match="another calibration there \\(focal_px\\)"):
            writer(tmp_path, run="q", camera_json=CAMERA | {"focal_px": 1.0})
        store(tmp_path, walk(50), run="q")
        other.send_signal(signal.SIGKILL)
        other.wait()
    assert [run.run for run in complete_runs(tmp_path)] == ["q"]
    store(tmp_path, walk(100))
    assert [(run.run, run.track_base) for run in complete_runs(tmp_path)] == [
        ("r", 0),  # it came first, and has kept its numbers
        ("q", RUN_TRACKS),
    ]
    assert table(tmp_path).equals(table(store(tmp_path / "alone", walk(100))))


def test_two_processes_write_two_runs_at_once(tmp_path):
    with beyond(tmp_path, "a", "c") as first, beyond(tmp_path, "b", "d") as second:
        for process in (first, second):
            assert process.stdout.readline() == "ready\n"
        for process in (first, second):
            process.communicate("\n", timeout=30)
            assert process.returncode == 0
    assert {run.track_base for run in complete_runs(tmp_path)} == {0, RUN_TRACKS}
    a, b = (set(table(tmp_path, run)["track"].to_pylist()) for run in "ab")
    assert a
    assert b
    assert not a & b


def test_the_same_process_cannot_write_a_run_twice_at_once(tmp_path):
    with writer(tmp_path) as out:
        with pytest.raises(InputError, match=f"process {os.getpid()}"):
            writer(tmp_path)
        out.write(walk(10))
    assert table(tmp_path).num_rows == 10


def test_a_rerun_keeps_its_track_numbers(tmp_path):
    for run in ("a", "b", "a", "c", "b"):
        store(tmp_path, walk(60), run=run)
    bases = {run.run: run.track_base // RUN_TRACKS for run in complete_runs(tmp_path)}
    assert bases == {"a": 0, "b": 1, "c": 2}
    assert len(parts(tmp_path)) == 6


# Bad input


@pytest.mark.parametrize(
    "name", ["../x", "a/b", "con", "Müller 人", ".hidden", "a=b%2F", "*?[x]", "人" * 60]
)
def test_names_stay_inside_the_scene(tmp_path, name):
    folder = tmp_path / "s"
    store(folder, walk(60), camera=name, run=name)
    store(folder, walk(70), camera=name, run=name)
    assert [p.name for p in tmp_path.iterdir()] == ["s"]
    assert sorted(p.name for p in folder.iterdir()) == ["cameras", "runs", "tracks"]
    assert len(files(folder)) == 5
    scene = Scene.open(folder)
    assert scene.cameras == (name,)
    assert len(scene.tracks(cameras=[name])) == 70
    assert json.loads(scene.camera_file(name).read_text()) == CAMERA


@pytest.mark.parametrize("name", ["", "a\0b", "a\nb", "\ud800"])
def test_names_that_no_file_can_have_are_refused(tmp_path, name):
    for options in ({"camera": name}, {"run": name}):
        with pytest.raises(InputError, match=next(iter(options))):
            writer(tmp_path / "s", **options)
    assert not list(tmp_path.iterdir())


def test_long_names_are_shortened_and_stay_apart(tmp_path):
    names = ["人" * 60 + end for end in ("", "a", "b")]
    for name in names:
        store(tmp_path, walk(30), camera=name, run=name)
    assert all(len(p.name) < 255 for p in tmp_path.rglob("*"))
    assert Scene.open(tmp_path).cameras == tuple(names)
    plain = file_name("x" * 200, "run")
    assert plain == "x" * 200
    assert len(file_name("x" * 201, "run")) > len(plain), "no short name looks like a shortened one"


@pytest.mark.parametrize("name", [".r.claim", ".r.lock", ".lock", "r.json"])
def test_a_link_is_not_followed(tmp_path, name):
    victim, folder = tmp_path / "victim", tmp_path / "s"
    victim.write_text("precious")
    (folder / "runs").mkdir(parents=True)
    (folder / "runs" / name).symlink_to(victim)
    with suppress(OutputError, InputError):
        store(folder, walk(30))
    assert victim.read_text() == "precious"


@pytest.mark.parametrize("name", [".r", ".r.claim", ".r.lock"])
def test_a_link_where_a_run_is_written_is_refused(tmp_path, name):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "s/runs").mkdir(parents=True)
    (tmp_path / "s/runs" / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=f"{name}: is a symbolic link, which is not followed"):
        writer(tmp_path / "s")
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize(
    "said", ["[]", "{", '{"run": 1}', '{"run": 1, "camera": 2, "track_base": "x", "pid": {}}']
)
def test_a_claim_of_wrong_types_counts_for_nothing(tmp_path, said):
    (tmp_path / "runs").mkdir()
    for name in (".r.claim", ".other.claim"):
        (tmp_path / "runs" / name).write_text(said)
    store(tmp_path, walk(30))
    assert complete_runs(tmp_path)[0].track_base == 0


def _with(**values):
    tracks = walk(10)
    for name, value in values.items():
        getattr(tracks, name)[3] = value
    return tracks


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"class_name": "cat"}, "row 3: class_name is 'cat', expected one of person"),
        ({"time_s": np.nan}, "row 3: time_s is nan"),
        ({"time_s": 1e10}, "row 3: time_s"),
        ({"track": -1}, "row 3: track is -1"),
        ({"track": RUN_TRACKS}, "row 3: track"),
    ],
)
def test_rows_that_a_scene_cannot_hold(tmp_path, values, said):
    with pytest.raises(InputError, match=said), writer(tmp_path) as out:
        out.write(_with(**values))
    assert not complete_runs(tmp_path)


def test_one_run_has_one_skeleton(tmp_path):
    with pytest.raises(InputError, match=r"have 2 keypoints.*before 3"), writer(tmp_path) as out:
        out.write(walk(10, keypoints=3))
        out.write(walk(10, keypoints=2))


def test_another_calibration_under_the_same_name(tmp_path):
    store(tmp_path, walk(50))
    with pytest.raises(InputError, match=r"camera 'c' has another calibration.*focal_px"):
        writer(tmp_path, run="q", camera_json=CAMERA | {"focal_px": 900.0})
    store(tmp_path, walk(50), run="q", camera="d", camera_json={})


def test_the_same_camera_made_again_is_the_same(tmp_path):
    for number, day in enumerate(("2026-11-20", "2026-11-21")):
        store(tmp_path, walk(50), run=f"r{number}", camera_json=CAMERA | {"made": {"date": day}})
        elsewhere = CAMERA | {"made": {"date": day}}
        store(tmp_path / f"other{number}", walk(50), camera_json=elsewhere)
    assert Scene.open(tmp_path / "other0", tmp_path / "other1")


def test_a_dead_first_run_does_not_hold_the_camera(tmp_path):
    die(writer(tmp_path, camera_json={"focal_px": 1.0}))
    store(tmp_path, walk(50))
    assert json.loads((tmp_path / "cameras/c.json").read_text()) == CAMERA


def test_a_run_is_of_one_camera(tmp_path):
    store(tmp_path, walk(50))
    with pytest.raises(InputError, match="run 'r' is of camera 'c', not of 'd'"):
        writer(tmp_path, camera="d")


def test_other_bad_input(tmp_path):
    with pytest.raises(InputError, match="no time zone"):
        writer(tmp_path, start_utc=datetime(2009, 6, 1))
    with pytest.raises(InputError, match="camera_json: cannot be written as JSON"):
        writer(tmp_path, camera_json={"focal_px": float("nan")})
    out = writer(tmp_path)
    out.close()
    out.close()
    with pytest.raises(InputError, match="closed already"):
        out.write(walk(5))
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        writer(tmp_path / "file")


# Other readers


def test_pyarrow_reads_it(tmp_path):
    tracks = in_order(walk(100))
    store(tmp_path, tracks)
    one = pq.read_table(parts(tmp_path)[0])
    assert {"camera", "day", "x_m"} <= set(one.column_names)
    rows = table(tmp_path).sort_by([("track", "ascending"), ("time_s", "ascending")])
    np.testing.assert_array_equal(rows["x_m"].to_numpy(), tracks.xy_m[:, 0])
    assert rows["class"].to_pylist() == tracks.class_name.tolist()


def test_duckdb_reads_it(tmp_path):
    import duckdb

    tracks = walk(100)
    store(tmp_path, tracks, camera="Müller 1")
    query = (
        f"SELECT camera, count(*), sum(x_m), count(x1) FROM '{tmp_path}/**/*.parquet' GROUP BY 1"
    )
    ((camera, n, total, boxes),) = duckdb.sql(query).fetchall()
    assert (camera, n, boxes) == ("Müller 1", 100, np.isfinite(tracks.box_xyxy[:, 0]).sum())
    assert total == pytest.approx(tracks.xy_m[:, 0].sum())


def test_pandas_reads_it(tmp_path):
    pandas = pytest.importorskip("pandas")
    tracks = walk(100)
    store(tmp_path, tracks, camera="Müller 1")
    rows = pandas.concat([pandas.read_parquet(path) for path in parts(tmp_path)])
    assert set(rows["camera"]) == {"Müller 1"}
    assert str(rows["time"].dt.tz) == "UTC"
    assert rows["y_m"].sum() == pytest.approx(tracks.xy_m[:, 1].sum())
    assert rows["x1"].isna().sum() == np.isnan(tracks.box_xyxy[:, 0]).sum()


def test_polars_reads_it(tmp_path):
    polars = pytest.importorskip("polars")
    tracks = walk(100)
    store(tmp_path, tracks, camera="Müller 1")
    rows = polars.read_parquet(tmp_path / "tracks/camera=*/day=*/*.parquet")
    assert rows["camera"].unique().to_list() == ["Müller 1"]
    assert rows["y_m"].sum() == pytest.approx(tracks.xy_m[:, 1].sum())
    assert rows["x1"].null_count() == np.isnan(tracks.box_xyxy[:, 0]).sum()
