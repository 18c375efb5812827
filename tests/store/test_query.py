"""Questions to a scene, against the same questions to NumPy; and what is no answer."""

import hashlib
import json
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stored_scenes import CAMERA, NOON, assert_same, in_order, store, walk, writer

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.store._parts import check_parts
from scene4d.store.query import Scene
from scene4d.store.schema import COLUMN_NAMES, RUN_TRACKS

WALKED = walk(600, objects=9)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return store(tmp_path_factory.mktemp("scene"), WALKED, rows_per_part=100)


@pytest.fixture(scope="module")
def scene(folder):
    return Scene.open(folder)


def test_all_of_it(scene):
    assert len(scene) == 600
    assert scene.cameras == ("c",)
    assert scene.classes == {n: (WALKED.class_name == n).sum() for n in ("car", "person")}
    assert_same(scene.tracks(), in_order(WALKED))
    rows = pa.table(scene.rows())
    assert tuple(rows.column_names) == COLUMN_NAMES
    assert str(rows.schema.field("time").type) == "timestamp[ns, tz=UTC]"
    assert rows["heading_sigma_rad"].null_count == np.isnan(WALKED.heading_sigma_rad).sum()


def some(values):
    return st.none() | st.lists(st.sampled_from(values), min_size=1, max_size=3)


@settings(max_examples=60, deadline=None)
@given(
    begin=st.none() | st.floats(-1, 8) | st.integers(0, 60).map(lambda i: i / 10),
    length=st.none() | st.floats(0.01, 8),
    absolute=st.booleans(),
    classes=some(["person", "car"]),
    tracks=st.none() | st.lists(st.integers(0, 12)),
    corner=st.none() | st.tuples(st.floats(-9, 5), st.floats(-9, 5), st.floats(0, 9)),
    observed=st.none() | st.booleans(),
)
def test_filters_agree_with_numpy(
    scene, begin, length, absolute, classes, tracks, corner, observed
):
    end = None if length is None else (begin or 0.0) + length
    within = None if corner is None else (corner[0], corner[1], *(np.add(corner[:2], corner[2])))
    within = within and tuple(float(v) for v in within)
    asked = {"begin": begin, "end": end}
    if absolute:  # to the microsecond that a datetime has
        asked = {k: v and round(v, 6) for k, v in asked.items()}
        begin, end = asked.values()
        asked = {k: v if v is None else NOON + timedelta(seconds=v) for k, v in asked.items()}
    keep = np.ones(600, bool)
    keep &= True if begin is None else WALKED.time_s >= begin
    keep &= True if end is None else WALKED.time_s < end
    keep &= True if classes is None else np.isin(WALKED.class_name, classes)
    keep &= True if tracks is None else np.isin(WALKED.track, tracks)
    keep &= True if observed is None else WALKED.observed == observed
    if within is not None:
        low, high = np.array(within[:2]), np.array(within[2:])
        keep &= ((WALKED.xy_m >= low) & (WALKED.xy_m <= high)).all(axis=1)
    asked |= {"classes": classes, "tracks": tracks, "within_m": within, "observed": observed}
    found = scene.tracks(**asked)
    expected = in_order(WALKED.select(keep))
    np.testing.assert_array_equal(found.track, expected.track)
    np.testing.assert_array_equal(found.frame, expected.frame)
    np.testing.assert_array_equal(found.xy_m, expected.xy_m)
    rows = scene.rows(**asked, columns=["frame", "track"])
    assert rows.column_names == ["frame", "track"]
    assert rows.num_rows == len(expected)


def test_a_row_without_a_place_is_in_no_rectangle(tmp_path):
    tracks = walk(50)
    tracks.xy_m[::2] = np.nan
    scene = Scene.open(store(tmp_path, tracks))
    everywhere = (-np.inf, -np.inf, np.inf, np.inf)
    assert len(scene.tracks(within_m=everywhere)) == 25
    assert len(scene.tracks()) == 50


def test_other_time_zones_are_the_same_moments(scene):
    begin = NOON + timedelta(seconds=2)
    there = begin.astimezone(timezone(timedelta(hours=-7)))
    assert_same(scene.tracks(begin=there), scene.tracks(begin=begin))


def test_runs_taken_one_by_one_ask_one_duckdb(tmp_path, monkeypatch):
    import duckdb

    begun = []
    connect = duckdb.connect
    monkeypatch.setattr(duckdb, "connect", lambda **how: begun.append(1) or connect(**how))
    for run in ("first", "second"):
        store(tmp_path, walk(60), run=run)
    scene = Scene.open(tmp_path)
    alone = [scene.only(run.run) for run in scene.runs]
    assert begun == []
    assert [len(one.tracks()) for one in alone] == [60, 60]
    counts = [one.sql("SELECT count(*) AS n FROM scene")["n"].to_pylist() for one in alone]
    assert counts == [[60], [60]]
    assert begun == [1]


def test_only_the_parts_that_can_answer_are_opened(tmp_path):
    folder = tmp_path
    store(folder, walk(400), rows_per_part=100)
    tracks = walk(400)
    late = tracks.select(np.argsort(tracks.time_s, kind="stable"))
    store(folder, late, rows_per_part=100)
    manifest = json.loads((folder / "runs/r.json").read_text())
    first, *others = manifest["parts"]
    for part in others:
        (folder / part["path"]).unlink()
    scene = Scene.open(folder)
    end = others[0]["begin_s"]
    assert len(scene.tracks(end=end)) == (late.time_s < end).sum() > 0
    with pytest.raises(InputError, match=others[0]["path"] + ": is not there"):
        scene.tracks(begin=first["end_s"])


def test_a_stream_that_replaces_its_parts_is_read_on(tmp_path, monkeypatch):
    """A part can go before it is looked at, and between that and its reading; a run that was
    written anew is another one.
    """
    out = writer(tmp_path)
    out._live = True
    monkeypatch.setattr("scene4d.store.writing._KEPT_S", -1.0)

    def grow(time_s):
        out.write(walk(30, seed=int(time_s), start_s=time_s))
        out.commit(walk(9, seed=9, start_s=1000.0))

    def counted(scene):
        return scene.sql("SELECT count(*) AS n FROM scene")["n"][0].as_py()

    grow(0.0)
    scene = Scene.open(tmp_path)
    assert len(scene.tracks()) == 39
    grow(100.0)
    assert [len(scene.tracks()), len(scene), counted(scene)] == [69, 69, 69]
    late = [200.0, 300.0]

    def checked(*parts):
        check_parts(*parts)
        if late:
            grow(late.pop(0))

    monkeypatch.setattr("scene4d.store.query.check_parts", checked)
    assert len(scene.only("r").tracks()) == 129
    late = [400.0]
    assert counted(scene) == 159
    late = [500.0, 600.0, 700.0]
    with pytest.raises(InputError, match="is not there; if run 'r' was written again"):
        scene.tracks()
    out.close()
    assert len(scene.tracks()) == 30 * 8
    monkeypatch.undo()
    with writer(tmp_path) as anew:
        anew._run = replace(anew.run, provenance={"weights": "others"})
        anew.write(walk(20))
    with pytest.raises(InputError, match="is not there; if run 'r' was written again"):
        scene.tracks()


def test_a_part_that_no_manifest_names_is_not_there(tmp_path):
    store(tmp_path, walk(100))
    part = next(tmp_path.glob("tracks/camera=*/day=*/*.parquet"))
    part.with_name("q-00000.parquet").write_bytes(part.read_bytes())
    out = writer(tmp_path, run="s")
    out.write(walk(100))
    scene = Scene.open(tmp_path)
    assert len(scene.tracks()) == 100
    out.close()
    assert len(scene.tracks()) == 100
    assert len(Scene.open(tmp_path).tracks()) == 200


def test_two_cameras_in_one_scene(tmp_path):
    store(tmp_path, walk(100), run="a", camera="north")
    store(tmp_path, walk(120, seed=1), run="b", camera="south", camera_json={"focal_px": 1})
    scene = Scene.open(tmp_path)
    assert scene.cameras == ("north", "south")
    assert len(scene.tracks(cameras=["north"])) == 100
    south = scene.tracks(cameras=["south"])
    assert len(south) == 120
    assert south.track.min() >= RUN_TRACKS
    assert json.loads(scene.camera_file("south").read_text()) == {"focal_px": 1}
    with pytest.raises(InputError, match="camera 'west' is not in the scene; there: north, south"):
        scene.camera_file("west")


def test_tracks_of_two_folders_stay_apart(tmp_path):
    first = store(tmp_path / "a", walk(100))
    store(first, walk(100, seed=3), run="q")
    second = store(tmp_path / "b", walk(80, seed=1), camera="d")
    scene = Scene.open(first, second)
    assert len(scene) == 280
    tracks = scene.tracks()
    by_run = tracks.track // RUN_TRACKS
    assert [(by_run == i).sum() for i in range(3)] == [100, 100, 80]
    one = int(tracks.track[-1])
    assert (scene.tracks(tracks=[one]).track == one).all()
    moved = scene.tracks(cameras=["d"])
    assert_same(
        Tracks(**(vars(moved) | {"track": moved.track - 2 * RUN_TRACKS})),
        in_order(walk(80, seed=1)),
    )


def test_sql(scene):
    answer = pa.table(
        scene.sql(
            "SELECT class, count(*) AS n, min(time) AS first FROM scene GROUP BY 1 ORDER BY 1"
        )
    )
    assert answer["class"].to_pylist() == ["car", "person"]
    assert dict(zip(answer["class"].to_pylist(), answer["n"].to_pylist(), strict=True)) == (
        scene.classes
    )
    assert answer["first"].to_numpy()[0] == np.datetime64("2009-06-01T12:00:00")
    assert answer.schema.field("first").type.tz == "UTC"


def test_rows_with_different_skeletons_are_not_one_table(tmp_path):
    store(tmp_path, walk(50, keypoints=3), run="a")
    store(tmp_path, walk(50, keypoints=2), run="b", camera="d")
    scene = Scene.open(tmp_path)
    with pytest.raises(InputError, match="skeletons of 2 and 3 keypoints"):
        scene.tracks()
    assert scene.tracks(cameras=["d"]).keypoint_uv.shape == (50, 2, 2)
    assert scene.rows().num_rows == 100


# Bad input


def test_there_is_no_scene(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError, match="holds no scene"):
            Scene.open(path)
    out = writer(tmp_path)
    out.write(walk(10))
    with pytest.raises(InputError, match="holds no scene"):
        Scene.open(tmp_path)
    out.abandon()


def test_the_scene_is_empty(tmp_path):
    writer(tmp_path).close()
    with pytest.raises(InputError, match="the scene is empty"):
        Scene.open(tmp_path)


def test_a_folder_named_twice(folder):
    with pytest.raises(InputError, match="named twice"):
        Scene.open(folder, folder / "." / "runs" / "..")


def test_another_schema(tmp_path):
    store(tmp_path, walk(10))
    path = tmp_path / "runs/r.json"
    manifest = json.loads(path.read_text())
    for change, said in (
        (
            {"schema": "scene4d/scene/7"},
            "field \"schema\" must be 'scene4d/scene/1', found 'scene4d/scene/7'",
        ),
        ({"parts": [{"path": "tracks/x"}]}, r"field 'parts\[0\].begin_s' is missing"),
    ):
        path.write_text(json.dumps(manifest | change))
        with pytest.raises(InputError, match=f"r.json: {said}"):
            Scene.open(tmp_path)
    del manifest["rows"]
    path.write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="field 'rows' is missing"):
        Scene.open(tmp_path)


def test_two_calibrations_of_one_name(tmp_path):
    first = store(tmp_path / "a", walk(10))
    second = store(tmp_path / "b", walk(10), camera_json=CAMERA | {"focal_px": 1})
    with pytest.raises(InputError, match="camera 'c' has another calibration in"):
        Scene.open(first, second)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"classes": ["person", "cat"]}, "class 'cat' is not in the scene; there: car, person"),
        ({"classes": ["bus"]}, "class 'bus' is not in the scene"),
        ({"classes": "person"}, "expected a list"),
        ({"cameras": []}, "camera: found an empty list"),
        ({"cameras": ["d"]}, "camera 'd' is not in the scene; there: c"),
        ({"columns": ["x"]}, "column 'x' is not in the scene; there: camera, track"),
        ({"begin": 2.0, "end": 2.0}, "begin 2.0 is not before end 2.0"),
        ({"begin": float("nan")}, "begin: is NaN"),
        ({"begin": datetime(2009, 6, 1)}, "begin: 2009-06-01T00:00:00 has no time zone"),
        ({"begin": NOON, "end": 3.0}, "one is a moment, one in seconds"),
        ({"within_m": (1.0, 0.0, 0.0, 1.0)}, "within_m: .*expected x0 <= x1"),
        ({"within_m": (0.0, 0.0, float("nan"), 1.0)}, "within_m"),
    ],
)
def test_questions_without_an_answer(scene, asked, said):
    with pytest.raises(InputError, match=said):
        scene.rows(**asked)


def test_moments_where_the_start_is_not_known(tmp_path):
    scene = Scene.open(store(tmp_path, walk(50), start_utc=None))
    with pytest.raises(InputError, match="ask in seconds"):
        scene.rows(begin=datetime(1970, 1, 1, tzinfo=UTC))
    assert scene.rows(begin=0.0).num_rows == 50


def test_wrong_sql(scene):
    for query in ("SELECT nothing FROM scene", "SELECT", "SELECT * FROM walk"):
        with pytest.raises(InputError, match="query: "):
            scene.sql(query)
    with pytest.raises(InputError, match="expected one SELECT"):
        scene.sql(" ; ")


def test_sql_reads_nothing_but_the_scene_and_writes_nothing(folder, tmp_path):
    secret, target = tmp_path / "secret.csv", tmp_path / "out.csv"
    secret.write_text("a,b\n1,2\n")
    part = next(folder.glob("tracks/camera=*/day=*/*.parquet"))
    before = part.read_bytes()
    scene = Scene.open(folder)
    for query in (
        f"SELECT * FROM read_csv('{secret}')",
        f"SELECT * FROM '{secret}'",
        f"SELECT content FROM read_text('{folder}/tracks/../runs/r.json')",
        f"SELECT * FROM glob('{tmp_path}/*')",
        f"COPY scene TO '{target}'",
        f"COPY (SELECT 1) TO '{part}'",
        f"EXPLAIN ANALYZE COPY (SELECT 1) TO '{target}'",
        f"ATTACH '{target}'",
        "SET enable_external_access = true",
        "INSTALL httpfs",
        "SELECT 1; SELECT 2",
    ):
        with pytest.raises(InputError, match="query: "):
            scene.sql(query)
    assert not target.exists()
    assert part.read_bytes() == before
    assert scene.sql("WITH a AS (FROM scene) SELECT count(*) AS n FROM a")["n"][0].as_py() == 600


def test_every_flipped_bit_is_found_and_the_part_named(tmp_path):
    store(tmp_path, walk(200), rows_per_part=100)
    path = sorted(tmp_path.glob("tracks/camera=*/day=*/*.parquet"))[1]
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for place in rng.integers(0, len(whole), 30).tolist():
        path.write_bytes(_flipped(whole, place, int(rng.integers(8))))
        for ask in (
            Scene.rows,
            Scene.tracks,
            lambda scene: scene.sql("SELECT max(x_m) FROM scene"),
        ):
            with pytest.raises(InputError, match=f"{path.name}: is damaged: its content"):
                ask(Scene.open(tmp_path))
    path.write_bytes(whole)
    assert len(Scene.open(tmp_path).tracks()) == 200


def _flipped(content, place, bit):
    return content[:place] + bytes([content[place] ^ 1 << bit]) + content[place + 1 :]


def test_a_part_is_verified_once(tmp_path, monkeypatch):
    store(tmp_path, walk(200), rows_per_part=100)
    digests = []
    digest = hashlib.file_digest
    monkeypatch.setattr(hashlib, "file_digest", lambda *a: digests.append(1) or digest(*a))
    # What is older than its manifest is as it was written.
    assert len(Scene.open(tmp_path).tracks()) == 200
    assert len(digests) == 0
    for path in tmp_path.glob("tracks/camera=*/day=*/*.parquet"):
        path.touch()
    scene = Scene.open(tmp_path)
    for one in (scene, scene.only("r"), scene):
        assert len(one.tracks()) == 200
    assert len(digests) == 2


def test_a_part_that_cannot_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    store(tmp_path, walk(50), rows_per_part=100)

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    scene = Scene.open(tmp_path)
    for path in tmp_path.glob("tracks/camera=*/day=*/*.parquet"):
        path.touch()
    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(InputError, match=r"\.parquet: cannot be read: Permission denied$"):
        scene.tracks()


@pytest.mark.parametrize(
    "path", ["/etc/passwd", "../../x.parquet", "tracks/../../x", "runs/r.json", "C:/x"]
)
def test_a_manifest_names_parts_of_its_own_scene_only(tmp_path, path):
    store(tmp_path, walk(10))
    _change(tmp_path, lambda manifest: manifest["parts"][0].update(path=path))
    with pytest.raises(InputError, match=r"r.json: field 'parts\[0\].path' must be a path below"):
        Scene.open(tmp_path)


@pytest.mark.parametrize(
    "span", [{"end_s": 1e308}, {"begin_s": -1e308}, {"begin_s": 2.0, "end_s": 1.0}]
)
def test_a_part_lasts_as_long_as_footage_can(tmp_path, span):
    """An export went on without end (R15)."""
    store(tmp_path, walk(10))
    _change(tmp_path, lambda manifest: manifest["parts"][0].update(span))
    with pytest.raises(InputError, match=r"r.json: field 'parts\[0\].(begin|end)_s' must be"):
        Scene.open(tmp_path)


def _change(folder, change):
    path = folder / "runs/r.json"
    manifest = json.loads(path.read_text())
    change(manifest)
    path.write_text(json.dumps(manifest))


def test_manifests_of_wrong_types_are_bad_input(tmp_path):
    store(tmp_path, walk(10))
    whole = json.loads((tmp_path / "runs/r.json").read_text())
    wrong = (None, True, -1, 1.5, 10**400, "x", [], [1], {}, {"a": "b"})
    fields = [(name, None) for name in whole if name not in ("begin", "end", "start", "columns")]
    for name, part in fields + [("parts", inner) for inner in whole["parts"][0]]:
        right = whole["parts"][0][part] if part else whole[name]
        for value in wrong:
            changed = json.loads(json.dumps(whole))
            if part:
                changed["parts"][0][part] = value
            else:
                changed[name] = value
            (tmp_path / "runs/r.json").write_text(json.dumps(changed))
            fits = type(value) is type(right) or (part == "sha256" and value is None)
            fits |= part in ("begin_s", "end_s") and value in (-1, 1.5)
            try:
                Scene.open(tmp_path)
            except InputError as error:
                assert any(word in str(error) for word in ("r.json", "x.json", "empty"))
                assert len(str(error)) < 400
            else:
                assert fits, (name, part, value)


def test_a_scene_is_a_table_for_other_libraries(scene, monkeypatch):
    assert pa.table(scene).num_rows == len(scene)
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # the extra pandas does not bring it
    frame = scene.to_pandas(classes=["car"])
    assert frame["class"].unique().tolist() == ["car"]
    assert str(frame["time"].dtype) == "datetime64[ns, UTC]"
    with pytest.raises(TypeError, match="unknown keyword 'class_'"):
        scene.rows(class_=["car"])


def test_a_notebook_shows_what_is_there_and_the_paths(scene):
    html = scene._repr_html_()
    assert "600" not in html and f"{scene.classes['car']:,} x car" in html
    assert html.count("<polyline") == len(np.unique(WALKED.track))
    assert "http" not in html
    paths = scene.paths("c", 10**6)
    expected = in_order(WALKED)
    for track, (name, xy) in paths.items():
        rows = expected.track == track
        assert name == expected.class_name[rows][0]
        np.testing.assert_array_equal(xy, expected.xy_m[rows])
    assert 60 <= sum(len(xy) for _, xy in scene.paths("c", 60).values()) <= 60 + 2 * len(paths)


def _ruin(content):
    return content[:4] + b"\xff" * (len(content) - 1000) + content[-996:]


@pytest.mark.parametrize(
    ("damage", "said"), [(lambda b: b[:-9], "is damaged: has"), (_ruin, "is damaged")]
)
def test_a_damaged_part_is_named(tmp_path, damage, said):
    store(tmp_path, walk(200), rows_per_part=100)
    path = sorted(tmp_path.glob("tracks/camera=*/day=*/*.parquet"))[1]
    path.write_bytes(damage(path.read_bytes()))
    scene = Scene.open(tmp_path)
    for ask in (scene.rows, scene.tracks, lambda: scene.sql("SELECT sum(x_m) FROM scene")):
        with pytest.raises(InputError, match=f"{path.name}: {said}"):
            ask()


def test_names_and_folders_that_mean_something_to_sql(tmp_path):
    name = 'it\'s "a" camera; DROP'
    folder = tmp_path / "we[i]rd *?' folder"
    scene = Scene.open(store(folder, walk(60), camera=name))
    assert len(scene.tracks(cameras=[name])) == 60
    assert scene.sql("SELECT count(*) AS n FROM scene")["n"].to_pylist() == [60]


@pytest.mark.parametrize("missing", [10, 9, 1])
def test_runs_of_before_columns_were_added_are_read_beside_new_ones(tmp_path, monkeypatch, missing):
    from scene4d.store import runs, schema

    whole = schema.COLUMNS
    old = walk(30)
    colours = np.random.default_rng(0).random((30, 46)).astype(np.float32)
    colours[:5, 23:], colours[5:8] = 0.0, 0.0
    new = replace(walk(30), existence_probability=np.full(30, 0.9), colours=colours)
    with monkeypatch.context() as before:
        for module in (runs, schema):
            before.setattr(module, "COLUMNS", whole[:-missing])
        store(tmp_path, old, run="old")
    only = Scene.open(tmp_path).tracks()
    assert np.isnan(only.existence_probability).all() == (missing == 10)
    assert (np.isnan(only.z_m).all() and np.isnan(only.size_m).all()) == (missing > 1)
    assert only.colours.shape == (30, 0)
    store(tmp_path, new, run="new")
    both = Scene.open(tmp_path)
    assert both.sql("SELECT count(z_m) AS n FROM scene")["n"].to_pylist() == [
        60 - 30 * (missing > 1)
    ]
    assert both.sql("SELECT count(colours) AS n FROM scene")["n"].to_pylist() == [27]
    found = both.only("new").tracks()
    assert (found.existence_probability == 0.9).all()
    np.testing.assert_allclose(
        found.colours, new.select(np.lexsort((new.time_s, new.track))).colours, atol=6e-5
    )
    assert len(both.tracks()) == 60
