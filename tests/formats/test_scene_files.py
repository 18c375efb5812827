"""How scenes become files: piece by piece, whole or not at all, and what is refused."""

import csv
import sys
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from export_scenes import (
    GOLDEN,
    START,
    moved,
    scene,
    tracks_of,
    without_nowhere,
    write_golden,
)

from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.formats.scenes import SceneTable, scene_formats, write_scene

FORMATS = [f for f in scene_formats() if f.name != "rerun"]  # its SDK is too large for tests
NAMES = [f.name for f in FORMATS]
STREAMED = ["csv", "mot", "kpf"]


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", NAMES)
def test_pieces_equal_the_whole(tmp_path, name):
    table = without_nowhere()
    cuts = [table.tracks.frame < 30, np.zeros(7, bool), table.tracks.frame >= 30]
    pieces = (replace(table, tracks=table.tracks.select(cut)) for cut in cuts)
    for folder, what in (("whole", table), ("pieces", pieces)):
        (tmp_path / folder).mkdir()
        written = write_scene(what, tmp_path / folder / "a", name)
    for path in written:
        assert path.read_bytes() == (tmp_path / "whole" / path.name).read_bytes()


@pytest.mark.parametrize("name", STREAMED)
def test_only_one_piece_is_held(tmp_path, name):
    """Each piece is written before the next one is asked for."""
    asked = []

    def pieces():
        for k in range(3):
            asked.append(sum(p.stat().st_size for p in tmp_path.iterdir()))
            yield moved(large, 2000 * k)

    n = 2000
    many = tracks_of(np.ones(n), np.arange(n), xy=np.ones((n, 2)))
    large = scene(many)
    write_scene(pieces(), tmp_path / "a", name)
    assert asked[0] < asked[1] < asked[2]


def test_large_pieces_are_cut(tmp_path, monkeypatch):
    monkeypatch.setattr("scene4d.formats.scenes._values.ROWS_AT_ONCE", 2)
    write_golden(tmp_path)
    for path in GOLDEN.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


@pytest.mark.parametrize("name", ["mot", "kpf"])
def test_pieces_out_of_order_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="found frame 0 after frame 990"):
        write_scene([moved(scene(), 900), scene()], tmp_path / "a", name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [n for n in NAMES if n != "csv"])
def test_pieces_of_two_clips_are_refused(tmp_path, name):
    later = moved(without_nowhere(), 900)
    other = replace(later, start_utc=START + timedelta(hours=1))
    with pytest.raises(InputError, match="differ in start_utc"):
        write_scene([without_nowhere(), other], tmp_path / "a", name)
    assert not list(tmp_path.iterdir())


def test_csv_takes_the_clips_of_many_cameras(tmp_path):
    first = without_nowhere()
    other = replace(first, camera="G341", start_utc=START + timedelta(hours=1))
    write_scene([first, other], tmp_path / "a.csv", "csv")
    rows = rows_of(tmp_path / "a.csv")
    assert len(rows) == 2 * len(first.tracks)
    assert rows[-1]["time_utc"] == "2018-03-07T18:05:04Z"


def test_csv_refuses_pieces_of_other_columns(tmp_path):
    with pytest.raises(InputError, match="some have not, so the columns differ"):
        write_scene([scene(), scene(geo=None)], tmp_path / "a.csv", "csv")
    bare = replace(scene(tracks_of([1], [0])), keypoint_names=())
    with pytest.raises(InputError, match="differ in keypoint_names"):
        write_scene([scene(), bare], tmp_path / "a.csv", "csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("pieces", [0, 2])
def test_an_empty_scene_is_refused(tmp_path, name, pieces):
    empty = replace(scene(), tracks=scene().tracks.select(np.zeros(0, int)))
    with pytest.raises(InputError, match="a: the scene holds no rows"):
        write_scene([empty] * pieces, tmp_path / "a", name)
    assert not list(tmp_path.iterdir())


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(InputError, match="known: csv, mot, kpf, geojson, moving-features"):
        write_scene(scene(), tmp_path / "a", "xlsx")


@pytest.mark.parametrize("name", NAMES)
def test_a_folder_is_never_replaced(tmp_path, name):
    for taken in ("a", "a.types.yml"):
        (tmp_path / taken).mkdir(exist_ok=True)
    with pytest.raises(OutputError, match="Is a directory"):
        write_scene(without_nowhere(), tmp_path / "a", name)


@pytest.mark.parametrize("name", NAMES)
def test_what_fails_half_way_changes_nothing(tmp_path, name):
    def pieces():
        yield without_nowhere()
        raise RuntimeError("the disk with the scene is gone")

    paths = write_scene(without_nowhere(), tmp_path / "a", name)
    before = [p.read_bytes() for p in paths]
    with pytest.raises(RuntimeError):
        write_scene(pieces(), tmp_path / "a", name)
    assert [p.read_bytes() for p in paths] == before
    assert sorted(tmp_path.iterdir()) == sorted(paths)


def test_missing_folders_are_made(tmp_path):
    write_scene(without_nowhere(), tmp_path / "new" / "dir" / "a", "kpf")
    assert len(list((tmp_path / "new" / "dir").iterdir())) == 2


def test_folders_made_for_nothing_are_removed(tmp_path):
    with pytest.raises(InputError, match="where this scene lies is unknown"):
        write_scene(scene(geo=None), tmp_path / "new" / "dir" / "a.geojson", "geojson")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=r"a\.csv: cannot be written: Not a directory"):
        write_scene(scene(), tmp_path / "file" / "a.csv", "csv")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("name", ["csv", "geojson", "moving-features"])
def test_without_pyproj_the_extra_is_named(tmp_path, monkeypatch, name):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(UnavailableError, match=r"scene4d\[geo\]"):
        write_scene(without_nowhere(), tmp_path / "a", name)
    assert not list(tmp_path.iterdir())
    if name != "geojson":
        write_scene(without_nowhere(geo=None), tmp_path / "a", name)


def test_the_contract_is_kept_by_every_format():
    assert len(set(NAMES)) == len(NAMES)
    for chosen in FORMATS:
        assert chosen.suffixes
        assert {s for s, _ in chosen.write(iter([without_nowhere()]))} == set(chosen.suffixes)
    assert isinstance(scene(), SceneTable)
