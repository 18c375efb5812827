"""Scenes in, a site out: places, clocks and numbers that are right, and a clear word where not."""

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import scene4d
from alignment.stored_worlds import scene_of
from alignment.test_pairs import linked
from alignment.worlds import made_site
from scene4d.alignment import AlignOptions, _reading, align, aligning
from scene4d.alignment._reading import watched
from scene4d.core.errors import InputError
from scene4d.store.site import Site

NOON = datetime(2026, 11, 20, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def world():
    return linked(6)[0]


@pytest.fixture(scope="module")
def scenes(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("world")
    return [scene_of(folder / one.name, one) for one in world.seen]


@pytest.fixture
def known(monkeypatch):
    """The pair of the world's cameras, which is worked out once."""
    pair = linked(6)[2]

    def told(a, b, numbers, bounds):
        return replace(pair, a=numbers[0], b=numbers[1])

    monkeypatch.setattr(aligning, "link", told)


@pytest.fixture(scope="module")
def found(scenes):
    return align(scenes, scenes[0].parent / "site", pictures=False)


def test_two_cameras_become_a_site(found, world):
    assert found and not found.warnings
    site = found.site
    assert scene4d.align is align and isinstance(site, Site)
    assert site.cameras == ("cam0", "cam1")
    placed, truth = site.placements["cam1"], world.seen[1].truth
    apart = placed.parameters - truth.parameters
    sigma = np.sqrt(np.diag(placed.covariance))
    assert np.all(np.abs(apart) < 3.5 * sigma)
    said = found.to_dict()
    assert said["pairs"][0]["status"] == "ok" and said["pairs"][0]["people_in_common"] > 3
    assert said["seen_by_several"] > 3
    assert json.loads(json.dumps(said))["cameras"]["cam1"]["status"] == "ok"


def test_who_was_seen_by_both_is_one_and_where_he_was(found, world):
    site, known = found.site, found.site.identities
    rows = [
        site.camera_tracks(name, keypoints=False, tracks=np.unique(known.identity).tolist())
        for name in site.cameras
    ]
    both = sorted(set(rows[0].track.tolist()) & set(rows[1].track.tolist()))
    assert len(both) > 3
    gaps = []
    for number in both:
        a, b = (one.select(one.track == number) for one in rows)
        at = b.time_s[(b.time_s > a.time_s.min()) & (b.time_s < a.time_s.max())]
        there = np.column_stack([np.interp(at, a.time_s, a.xy_m[:, k]) for k in (0, 1)])
        near = b.xy_m[np.isin(b.time_s, at)]
        gaps += np.hypot(*(near - there).T).tolist()
    assert np.median(gaps) < 0.5
    assert len(site.tracks()) < sum(map(len, rows))


def test_what_cameras_err_by_together_is_read_again(found):
    """The shared covariance of a camera's rows is that of the site's modes."""
    site = Site.open(shutil.copytree(found.site.folder, found.site.folder.parent / "copy"))
    assert site.errors is not None and site.errors.cameras == site.cameras
    rows = site.camera_tracks("cam1", keypoints=False).select(np.arange(0, 400, 20))
    modes = site.error_modes("cam1", rows.xy_m)
    shared = modes @ modes.swapaxes(1, 2)
    by_clock = np.linalg.eigvalsh(rows.shared_covariance_m2 - shared)
    assert np.abs(by_clock).max() < 0.02
    each = site.placements["cam1"].covariance
    np.testing.assert_allclose(site.errors.of("cam1", "cam1")[:3, :3], each[:3, :3], atol=1e-6)
    said = json.loads((site.folder / "site.json").read_text())
    said["errors"]["matrix"][3][7] = 5.0
    (site.folder / "site.json").write_text(json.dumps(said))
    with pytest.raises(InputError, match=r"errors\.matrix"):
        Site.open(site.folder)
    said["errors"] = None
    (site.folder / "site.json").write_text(json.dumps(said))
    with pytest.raises(InputError, match="align again"):
        Site.open(site.folder).error_modes("cam1", np.zeros((1, 2)))
    assert len(Site.open(site.folder).tracks())


def test_clocks_that_are_known_are_only_corrected(world, tmp_path):
    offset_s = world.seen[1].truth.time_offset_s
    first = scene_of(tmp_path / "a", world.seen[0], start=NOON)
    start = NOON + timedelta(seconds=offset_s - 2.0)
    site = align([first, scene_of(tmp_path / "b", world.seen[1], start=start)], tmp_path / "site",
                 pictures=False).site  # fmt: skip
    assert site.start == min(NOON, start)
    assert site.placements["cam1"].time_offset_s == pytest.approx(2.0, abs=0.2)


def test_cameras_of_other_days_are_told_so(world, tmp_path):
    first = scene_of(tmp_path / "a", world.seen[0], start=NOON)
    other = scene_of(tmp_path / "b", world.seen[1], start=NOON + timedelta(days=1))
    found = align([first, other], tmp_path / "site")
    assert not found
    assert (
        "no common moment" in found.reason
        and "2026-11-20 12:00" in found.reason
        and "2026-11-21" in found.reason
    )
    assert Site.open(tmp_path / "site").cameras == ()
    with pytest.raises(InputError, match="no camera of the site has a place"):
        found.site.tracks()


def test_halves_of_one_footage_have_no_common_moment(world, tmp_path):
    """As are PETS S2L1's, cut in time: minutes apart, which a clock might be set wrong by."""
    rows = world.seen[0].tracks
    middle_s = float(np.mean(rows.time_s))
    parts = [rows.select(rows.time_s < middle_s), rows.select(rows.time_s > middle_s + 10)]
    scenes = [
        scene_of(tmp_path / name, world.seen[0], tracks=part, start=NOON, camera=name)
        for name, part in zip("ab", parts, strict=True)
    ]
    found = align(scenes, tmp_path / "site", pictures=False)
    assert not found
    assert "no common moment: by their clocks 1" in found.reason


def test_a_pair_that_moved_is_warned_of(scenes, tmp_path, monkeypatch):
    pair = replace(linked(6)[2], note="one of the cameras moved")
    monkeypatch.setattr(aligning, "link", lambda *_: pair)
    (said,) = align(scenes, tmp_path / "site", pictures=False).warnings
    assert said == "cameras 'cam0' and 'cam1': one of the cameras moved"


def test_a_map_that_does_not_tell_the_place_is_told_and_kept_out(known, scenes, tmp_path):
    road = {"type": "LineString", "coordinates": [[-0.94, 53.44], [-0.939, 53.44]]}
    (tmp_path / "road.geojson").write_text(json.dumps(road))
    found = align(scenes, tmp_path / "site", anchor=tmp_path / "road.geojson", pictures=False)
    assert found and any("frame of its own, off the map: " in one for one in found.warnings)
    said = json.loads((tmp_path / "site" / "site.json").read_text())["anchor"]
    assert said["status"] == "undetermined" and said["reason"]
    assert not found.site.anchor and found.site.placements["cam0"].x_m == 0.0


def test_a_camera_that_saw_nobody_is_undetermined(known, scenes, world, tmp_path):
    nobody = world.seen[0].tracks.select(np.zeros(0, int))
    empty = scene_of(tmp_path / "empty", world.seen[0], tracks=nobody, camera="dark")
    found = align([*scenes, empty], tmp_path / "site", pictures=False)
    assert found and "nobody" in found.site.placements["dark"].reason
    assert found.site.cameras == ("cam0", "cam1")
    with_nobody = align([scenes[0], empty], tmp_path / "other", pictures=False)
    assert not with_nobody and "nobody was tracked" in with_nobody.reason


def test_clocks_that_drift_apart_are_named_and_put_right(tmp_path):
    """By two thousandths: told within some minutes, not pulled back, and taken off."""
    world = made_site(3, drift_ppm=4000.0, minutes=8.0, per_minute=5.0)
    rate = world.drift[1]
    found = align([scene_of(tmp_path / s.name, s) for s in world.seen], tmp_path / "site",
                  pictures=False)  # fmt: skip
    (said,) = found.warnings
    assert "'cam1': its clock is fast by" in said and "s an hour" in said
    site = Site.open(tmp_path / "site")
    drift = site.placements["cam1"].drift
    assert abs(drift.rate - rate) < 2.5 * drift.sigma and drift.sigma < abs(rate) / 4
    assert site.placements["cam0"].drift is None
    seen, (_, clock) = site.camera_tracks("cam1"), *site.runs("cam1")
    offset_s = world.seen[1].truth.time_offset_s
    for clip_s in (seen.time_s.min() - offset_s, seen.time_s.max() - offset_s):
        true_s = (clip_s + offset_s) / (1 - rate)
        assert clock.in_site(clip_s) == pytest.approx(true_s, abs=0.1)
        assert clock.in_clip(clock.in_site(clip_s)) == pytest.approx(clip_s, abs=1e-6)


def test_bad_input_gets_a_clear_word(known, scenes, world, tmp_path):
    copy = shutil.copytree(scenes[0], tmp_path / "copy")
    for given, word in (
        ([scenes[0], scenes[0]], "there twice"),
        ([scenes[0], copy], "same rows"),
        ([scenes[0]], "one camera is no site"),
        ([scenes[0], tmp_path], "holds no scene"),
    ):
        with pytest.raises(InputError, match=word):
            align(given, tmp_path / "site")
    before = (scenes[0] / "cameras" / "cam0.json").read_bytes()
    with pytest.raises(InputError, match="a folder of its own"):
        align(scenes, scenes[0])
    assert (scenes[0] / "cameras" / "cam0.json").read_bytes() == before
    with pytest.raises(InputError, match="max_offset_s"):
        AlignOptions(max_offset_s=-1.0)
    assert not (tmp_path / "site" / "site.json").exists()


def test_runs_are_taken_or_left_with_a_word(known, world, tmp_path):
    seen = world.seen[0]
    scene = scene_of(tmp_path / "a", seen, start=NOON)
    part = seen.tracks.select(seen.tracks.time_s < seen.tracks.time_s.min() + 40)
    scene_of(tmp_path / "a", seen, tracks=part, run="again", start=NOON)
    scene_of(tmp_path / "a", seen, tracks=part, run="whenever")
    other = scene_of(tmp_path / "b", world.seen[1])
    found = align([scene, other], tmp_path / "site", pictures=False)
    text = " ".join(found.warnings)
    assert "'again' left out: it is of the same time as 'run'" in text
    assert "'whenever' left out: when it began is not known" in text
    assert found.site.placed("cam0").runs == ("run",)


def test_a_long_run_is_read_in_pieces_as_it_is_at_once(scenes, monkeypatch):
    camera = watched(scenes)[0][0]
    once = camera.tracks(None)
    monkeypatch.setattr(_reading, "_PIECE_S", 7.0)
    pieces = camera.tracks(None)
    for name in ("track", "time_s", "xy_m", "covariance_m2"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(once, name))
    assert (np.diff(once.track) >= 0).all() and len(once) > 1000


def test_cameras_of_one_name_are_told_apart_by_their_scenes(known, world, tmp_path):
    scenes = [scene_of(tmp_path / place / "s", one, camera="cam") for place, one in
              zip("ab", world.seen, strict=True)]  # fmt: skip
    with pytest.raises(InputError, match="'s/cam' is there twice"):
        align(scenes, tmp_path / "site")
    scenes = [scene_of(tmp_path / place, one, camera="cam") for place, one in
              zip("cd", world.seen, strict=True)]  # fmt: skip
    site = align(scenes, tmp_path / "site", pictures=False).site
    assert site.cameras == ("c/cam", "d/cam")
    assert len(site.camera_tracks("d/cam"))
