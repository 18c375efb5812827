"""Scenes written, read again and compared, with our readers and with those of others."""

import csv
import json
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta, timezone
from fractions import Fraction

import numpy as np
import pytest
import yaml
from export_scenes import (
    GOLDEN,
    SIZE,
    START,
    scene,
    tracks_of,
    walker,
    without_nowhere,
    write_golden,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.annotations import read_annotations
from scene4d.formats.scenes import write_scene


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_golden_files(tmp_path):
    """Written by ``python tests/formats/export_scenes.py`` and looked at by eye."""
    write_golden(tmp_path)
    expected = sorted(p.name for p in GOLDEN.iterdir())
    assert sorted(p.name for p in tmp_path.iterdir()) == expected
    for name in expected:
        assert (tmp_path / name).read_bytes() == (GOLDEN / name).read_bytes(), name


# CSV


def test_csv_lines_are_in_order_and_empty_where_unknown(tmp_path):
    write_scene(scene(), tmp_path / "a.csv", "csv")
    rows = rows_of(tmp_path / "a.csv")
    assert [(r["frame"], r["track"]) for r in rows[:3]] == [("0", "1"), ("0", "2"), ("30", "1")]
    bridged = next(r for r in rows if r["observed"] == "false")
    assert bridged["x1_px"] == bridged["score"] == bridged["left_ankle_u_px"] == ""
    assert float(bridged["x_m"]) == 4.4


@pytest.mark.parametrize("name", [f.name for f in fields(Tracks)])
def test_csv_holds_every_column_of_the_tracks(tmp_path, name):
    """Each entry of a row, off-diagonal covariances once."""
    before = scene(walker().select(np.array([0])))
    values = getattr(before.tracks, name)
    entries = [i for i in np.ndindex(values.shape) if "cov" not in name or i[1] <= i[2]]
    for entry in entries:
        other = values.astype("U9") if values.dtype.kind == "U" else values.copy()
        other[entry] = {"U": "car", "b": False}.get(values.dtype.kind, 7777)
        after = replace(before, tracks=replace(before.tracks, **{name: other}))
        for file, table in (("a.csv", before), ("b.csv", after)):
            write_scene(table, tmp_path / file, "csv")
        a, b = rows_of(tmp_path / "a.csv")[0], rows_of(tmp_path / "b.csv")[0]
        assert a != b, (name, entry)


def test_csv_without_anchor_and_start(tmp_path):
    write_scene(scene(geo=None, start_utc=None), tmp_path / "a.csv", "csv")
    rows = rows_of(tmp_path / "a.csv")
    assert not any("deg" in name for name in rows[0])
    assert {r["time_utc"] for r in rows} == {""}


def test_csv_quotes_what_needs_it(tmp_path):
    names = ['a "b", c', "line\nfeed", "NaN", " ", "Ünï"]
    tracks = tracks_of(np.arange(5), np.arange(5), class_name=names)
    write_scene(replace(scene(tracks), camera="north, gate"), tmp_path / "a.csv", "csv")
    rows = rows_of(tmp_path / "a.csv")
    assert [r["class"] for r in rows] == names
    assert {r["camera"] for r in rows} == {"north, gate"}


numbers = st.floats(-1e4, 1e4, allow_nan=False).map(lambda x: round(x, 3)) | st.just(np.nan)


@settings(max_examples=30)
@given(st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=20))
def test_csv_numbers_come_back(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    x, y, heading = np.array(values).T
    n = len(values)
    tracks = tracks_of(np.ones(n), np.arange(n), xy=np.column_stack([x, y]), heading_rad=heading)
    write_scene(scene(tracks, geo=None), path, "csv")
    for i, row in enumerate(rows_of(path)):
        for name, expected in (("x_m", x[i]), ("y_m", y[i]), ("heading_rad", heading[i])):
            found = float(row[name]) if row[name] else np.nan
            assert found == expected or (np.isnan(found) and np.isnan(expected))


# Times


@settings(max_examples=50)
@given(st.datetimes(datetime(1971, 1, 1), datetime(2200, 1, 1)), st.floats(0, 1e5, allow_nan=False))
def test_times_are_exact_to_the_nanosecond(tmp_path_factory, start, seconds):
    path = tmp_path_factory.mktemp("time") / "a.json"
    table = without_nowhere(start_utc=start.replace(tzinfo=UTC))
    tracks = table.tracks.select(np.array([0]))
    write_scene(
        replace(table, tracks=replace(tracks, time_s=np.array([seconds]))), path, "moving-features"
    )
    feature = json.loads(path.read_text())["features"][0]
    text = feature["temporalGeometry"]["datetimes"][0]
    assert text.endswith("Z")
    whole, _, part = text[:-1].partition(".")
    assert len(part) in (0, 3, 6, 9)
    passed = datetime.fromisoformat(whole) - start
    found = Fraction(passed // timedelta(microseconds=1), 10**6) + Fraction(f"0.{part or 0}")
    assert abs(found - Fraction(seconds)) <= Fraction(1, 10**9)


def test_the_start_may_be_in_any_time_zone(tmp_path):
    there = START.astimezone(timezone(timedelta(hours=-5)))
    write_scene(scene(), tmp_path / "a.csv", "csv")
    write_scene(scene(start_utc=there), tmp_path / "b.csv", "csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


# Formats that our own readers read


@st.composite
def boxed_tracks(draw):
    """Rows at any (track, frame), some bridged, some without a position."""
    keys = draw(
        st.lists(
            st.tuples(st.integers(0, 10**6), st.integers(0, 10**6)),
            min_size=1, max_size=20, unique=True,
        )
    )  # fmt: skip
    n = len(keys)
    thousandths = st.integers(0, 1_000_000)
    corner = np.array(draw(st.lists(st.tuples(thousandths, thousandths), min_size=n, max_size=n)))
    size = st.integers(1000, 500_000)
    extent = np.array(draw(st.lists(st.tuples(size, size), min_size=n, max_size=n)))
    box = np.hstack([corner, corner + extent]) / 1000.0
    seen = np.array([True, *draw(st.lists(st.booleans(), min_size=n - 1, max_size=n - 1))])
    names = draw(st.lists(st.sampled_from(["person", "car", "人"]), min_size=n, max_size=n))
    box[~seen] = np.nan
    xy = np.array(draw(st.lists(st.tuples(numbers, numbers), min_size=n, max_size=n)))
    track, frame = np.array(keys).T
    score = np.round(draw(st.floats(0, 1)), 3) * np.ones(n)
    return tracks_of(
        track, frame, class_name=names, xy=xy, box_xyxy=box, observed=seen, score=score
    )


@settings(max_examples=40)
@given(boxed_tracks())
def test_mot_round_trip(tmp_path_factory, tracks):
    path = tmp_path_factory.mktemp("mot") / "tracks.txt"
    write_scene(scene(tracks), path, "mot")
    found = read_annotations(path, image_size=(2000, 2000))
    expected = tracks.select(np.lexsort((tracks.track, tracks.frame)))
    expected = expected.select(expected.observed)
    np.testing.assert_array_equal(found.frame, expected.frame)
    np.testing.assert_array_equal(found.track, expected.track)
    np.testing.assert_allclose(found.box_xyxy, expected.box_xyxy, atol=1e-9)
    np.testing.assert_allclose(found.score, expected.score, atol=1e-9)
    world = np.loadtxt(path, delimiter=",", ndmin=2)[:, 7:]
    placed = np.isfinite(expected.xy_m).all(axis=1)
    np.testing.assert_array_equal(world[placed, :2], expected.xy_m[placed])
    assert (world[placed, 2] == 0).all()
    assert (world[~placed] == -1).all()


@settings(max_examples=40)
@given(boxed_tracks())
def test_kpf_round_trip(tmp_path_factory, tracks):
    folder = tmp_path_factory.mktemp("kpf")
    # The reader takes one class for a track, the writer that of most boxes.
    own = np.array([f"k{t % 5}" for t in tracks.track])
    write_scene(scene(replace(tracks, class_name=own)), folder / "clip", "kpf")
    found = read_annotations(folder / "clip.geom.yml", image_size=(2000, 2000))
    order = np.lexsort((tracks.track, tracks.frame))
    expected = tracks.select(order).select(tracks.observed[order])
    np.testing.assert_array_equal(found.frame, expected.frame)
    np.testing.assert_array_equal(found.track, expected.track)
    np.testing.assert_array_equal(found.box_xyxy, expected.box_xyxy)
    np.testing.assert_array_equal(found.class_name, [f"k{t % 5}" for t in expected.track])


def test_kpf_is_yaml_with_the_packets_of_meva(tmp_path):
    written = write_scene(scene(), tmp_path / "clip.geom.yml", "kpf")
    assert [p.name for p in written] == ["clip.geom.yml", "clip.types.yml"]
    geom = yaml.safe_load(written[0].read_text())
    assert geom[1]["geom"] == {"g0": "110.0 50.0 130.25 110.5", "id0": 0, "id1": 1, "ts0": 0}
    types = {
        p["types"]["id1"]: p["types"]["cset3"] for p in yaml.safe_load(written[1].read_text())[1:]
    }
    assert types == {
        1: {"person": 1.0},
        2: {"car": 0.6667, "truck": 0.3333},
        7: {"Fußgänger人": 1.0},
    }
    found = read_annotations(written[0], image_size=SIZE)
    assert set(found.class_name[found.track == 2]) == {"car"}


def test_the_path_of_kpf_is_a_name(tmp_path):
    for given_name in ("clip", "clip.types.yml", "clip.geom.yml"):
        write_scene(scene(), tmp_path / given_name, "kpf")
        assert sorted(p.name for p in tmp_path.iterdir()) == ["clip.geom.yml", "clip.types.yml"]
    with pytest.raises(InputError, match="expected a name before"):
        write_scene(scene(), tmp_path / ".geom.yml", "kpf")


def test_kpf_refuses_a_class_it_cannot_hold(tmp_path):
    tracks = tracks_of([1], [0], class_name="traffic light")
    with pytest.raises(InputError, match="clip: kpf: the class 'traffic light'"):
        write_scene(scene(tracks), tmp_path / "clip", "kpf")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["mot", "kpf"])
def test_formats_of_boxes_need_a_box(tmp_path, name):
    tracks = tracks_of([1], [0], box_xyxy=np.full((1, 4), np.nan))
    with pytest.raises(InputError, match="no row has a box"):
        write_scene(scene(tracks), tmp_path / "a", name)
    assert not list(tmp_path.iterdir())
