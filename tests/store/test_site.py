"""Sites on disk: what is written is read back, rows are where the placement says, and what several
cameras saw of one person is one row that errs by as much as it says.
"""

import json
import os
import shutil
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

import scene4d
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.placement import Placement
from scene4d.core.tracks import Tracks
from scene4d.store.fusing import fused
from scene4d.store.identities import Identities
from scene4d.store.regrounding import in_site, regrounded
from scene4d.store.runs import Run, manifest_path
from scene4d.store.site import Site, clock_s
from scene4d.store.site_file import SiteAnchor, SiteFile, is_site
from scene4d.store.site_writing import write_site
from site_worlds import CAMERA, NOON, Eye, place, seen, store, strolls

WEST = Eye("west", place(0.0, 0.0, 0.0), (-4.0, 0.0), 12.0, noise_m=0.1, shared_m=0.1)
EAST = Eye("east", place(30.0, 4.0, 160.0, 1.05, 7.3), (4.0, 0.0), 12.0, 0.2, 0.15)
SECONDS, N = 120.0, 12


def site_of(folder, eyes, walkers, *, start=None, refined=(), anchor=None, extra=()) -> Site:
    """A site whose placements and identities are true."""
    cameras, rows = dict(extra), []
    for eye in eyes:
        tracks, whose = seen(eye, walkers)
        cameras[eye.name] = store(folder / f"{eye.name}-scene", eye, tracks, start)
        rows += [(eye.name, track, who + 1, 1.0) for track, who in whose.items()]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    found = {name: Calibration.of_camera(CAMERA.disturbed(REFINED)) for name in refined}
    said = SiteFile(cameras, None if start is None else ns(start), anchor)
    write_site(
        folder / "site", said, Identities(*columns), refined=found, pictures={"plan.png": b"x"}
    )
    return Site.open(folder / "site")


REFINED = np.array([0.0, 0.01, 0.0, 0.03, 0.0])


def ns(moment) -> int:
    return int(moment.timestamp()) * 10**9


@pytest.fixture(scope="module")
def walkers():
    return strolls(N, SECONDS, 8.0)


@pytest.fixture(scope="module")
def site(tmp_path_factory, walkers) -> Site:
    return site_of(tmp_path_factory.mktemp("two"), [WEST, EAST], walkers)


def truth(walkers, tracks: Tracks) -> np.ndarray:
    """Where everybody really was."""
    at = np.full((len(tracks), 2), np.nan)
    for who, walker in enumerate(walkers):
        rows = tracks.track == who + 1
        for k in range(2):
            at[rows, k] = np.interp(tracks.time_s[rows], walker.time_s, walker.xy_m[:, k])
    return at


def test_what_is_written_is_read_back(site):
    said = json.loads((site.folder / "site.json").read_text())
    assert said["schema"] == "scene4d/site/1" and said["anchor"] is None
    east = said["cameras"]["east"]
    told = {name: east[name] for name in ("x_m", "y_m", "heading_deg", "scale", "time_offset_s")}
    assert told == pytest.approx(
        {"x_m": 30, "y_m": 4, "heading_deg": 160, "scale": 1.05, "time_offset_s": 7.3}
    )
    assert set(east["sigma"]) == set(told) and east["status"] == "ok"
    assert east["scene"] == "../east-scene"
    assert site.cameras == ("west", "east") and site.anchor is None and site.start is None
    np.testing.assert_allclose(site.placements["east"].parameters, EAST.placement.parameters)
    assert is_site(site.folder) and not is_site(site.folder.parent)
    assert scene4d.Site is Site


def test_rows_are_where_and_when_the_placement_says(site, walkers):
    """By 0.2 m of noise and 0.15 m of the camera's."""
    tracks = site.camera_tracks("east")
    error = tracks.xy_m - truth(walkers, tracks)
    assert np.isfinite(error).all()
    assert np.hypot(*np.median(error, axis=0)) < 0.5
    assert 0.18 < error.std() < 0.23
    assert (np.diff(tracks.track) >= 0).all()
    same = np.diff(tracks.track) == 0
    assert (np.diff(tracks.time_s)[same] > 0).all()
    np.testing.assert_allclose(tracks.covariance_m2[0], 0.2**2 * np.eye(2), atol=1e-9)
    np.testing.assert_allclose(tracks.shared_covariance_m2[0], 0.15**2 * np.eye(2), atol=1e-9)
    moving = np.array([np.gradient(w.xy_m[:, 0], w.time_s).mean() for w in walkers])
    assert np.corrcoef(moving[tracks.track - 1], tracks.velocity_mps[:, 0])[0, 1] > 0.5


def test_a_placement_that_is_unsure_moves_everybody_alike(walkers):
    tracks, _ = seen(WEST, walkers)
    unsure = replace(WEST.placement, covariance=np.diag([0.04, 0.09, 0.0, 0.0, 0.25]))
    there, sure = in_site(tracks, unsure), in_site(tracks, WEST.placement)
    np.testing.assert_allclose(there.covariance_m2, sure.covariance_m2)
    v = tracks.velocity_mps
    expected = sure.shared_covariance_m2 + np.diag([0.04, 0.09])
    expected += 0.25 * v[:, :, None] * v[:, None, :]
    np.testing.assert_allclose(there.shared_covariance_m2, expected)


def test_fused_rows_are_nearer_to_the_truth_and_say_so(tmp_path):
    """Every camera has one error in all its rows, so only many worlds tell its size."""
    walkers = strolls(4, 40.0, 5.0)
    ratio, alone, together = [], [], []
    for seed in range(20):
        parts = []
        for eye in (WEST, EAST):
            tracks, whose = seen(eye, walkers, seed)
            owner = np.array([whose[t] + 1 for t in tracks.track.tolist()])
            tracks = replace(in_site(tracks, eye.placement), track=owner)
            parts.append(tracks.select(np.lexsort((tracks.time_s, tracks.track))))
        both = fused(parts, 0.2)
        assert (np.diff(both.time_s)[np.diff(both.track) == 0] > 0.19).all()
        total = both.covariance_m2 + both.shared_covariance_m2
        error = both.xy_m - truth(walkers, both)
        double = total[:, 0, 0] < 0.13**2
        assert 0.2 < double.mean() < 0.95
        information = np.linalg.inv(total[double])
        ratio.append(np.einsum("ni,nij,nj->n", error[double], information, error[double]).mean())
        together.append((error[double] ** 2).mean())
        first = parts[0].xy_m - truth(walkers, parts[0])
        alone.append((first**2).mean())
    assert 1.4 < np.mean(ratio) < 2.7  # two coordinates: 2
    assert np.mean(together) < 0.85 * np.mean(alone)


def test_errors_that_all_rows_share_stay_shared():
    """Own errors of 0.3 m each become 0.21 m, shared ones of 0.4 m each 0.28 m: both are told."""
    tracks, _ = seen(replace(WEST, noise_m=0.3, shared_m=0.4), strolls(2, 30.0, 2.0))
    both = fused([tracks, tracks], 0.2)
    np.testing.assert_allclose(both.covariance_m2[:, 0, 0], 0.3**2 / 2, rtol=1e-4)
    np.testing.assert_allclose(both.shared_covariance_m2[:, 1, 1], 0.4**2 / 2, rtol=1e-4)
    np.testing.assert_allclose(both.heading_sigma_rad, 0.2 / np.sqrt(2))


def test_fusing_one_camera_keeps_its_rows_and_gaps():
    tracks, _ = seen(WEST, strolls(3, 40.0, 4.0))
    longest = np.bincount(tracks.track).argmax()
    one = tracks.select(tracks.track == longest)
    gap = (one.time_s < one.time_s[20]) | (one.time_s > one.time_s[20] + 3.0)
    found = fused([one.select(gap)], 0.1)
    np.testing.assert_allclose(found.xy_m, one.select(gap).xy_m, atol=1e-9)
    assert np.diff(found.time_s).max() > 2.8
    coarse = fused([one], 0.5)
    assert np.isnan(coarse.box_xyxy).all() and coarse.keypoint_uv.shape[1] == 0
    inside = (coarse.time_s > one.time_s[0]) & (coarse.time_s < one.time_s[-1])
    for k in range(2):
        wanted = np.interp(coarse.time_s, one.time_s, one.xy_m[:, k])
        np.testing.assert_allclose(coarse.xy_m[inside, k], wanted[inside], atol=0.3)


def test_a_site_reads_only_what_is_asked_for(site):
    everything = site.tracks()
    first, last = site.span_s
    assert first <= everything.time_s.min() + 0.2 and everything.time_s.max() <= last + 0.2
    some = site.tracks(begin=40.0, end=60.0)
    assert some.time_s.min() + 0.2 >= 40 and some.time_s.max() < 60.2
    pieces = list(site.stretches(20.0))
    assert len(Tracks.concatenate(pieces)) == pytest.approx(len(everything), rel=0.02)
    one = site.tracks(tracks=[3])
    assert set(one.track) == {3}
    near = site.camera_tracks("west", within_m=(-2.0, -2.0, 2.0, 2.0))
    assert len(near) and np.abs(near.xy_m).max() <= 2.0
    west = site.tracks(cameras=["west"])
    assert len(west) < len(everything)
    with pytest.raises(InputError, match="nobody"):
        site.tracks(cameras=["nobody"])
    with pytest.raises(InputError, match="x0 <= x1"):
        site.camera_tracks("west", within_m=(2.0, 0.0, -2.0, 1.0))
    with pytest.raises(InputError, match="seconds of the site's clock"):
        site.tracks(begin=NOON)


def test_a_site_in_a_notebook_and_as_tables(site):
    assert "west" in site._repr_html_() and "polyline" in site._repr_html_()
    frame = site.to_pandas(begin=10.0, end=20.0)
    assert {"track", "x_m", "time_s"} <= set(frame.columns) and len(frame)


def test_clocks_that_are_known_count_from_the_start_of_the_site(tmp_path, walkers):
    site = site_of(tmp_path, [WEST, EAST], walkers[:4], start=NOON)
    assert site.start == NOON
    (run,) = site.scene("east").runs
    assert clock_s(run, ns(NOON)) == 0.0
    assert clock_s(run, ns(NOON) - 10**9) == 1.0
    assert clock_s(run, None) == 0.0
    later = site.tracks(begin=NOON + timedelta(seconds=30))
    np.testing.assert_array_equal(later.time_s, site.tracks(begin=30.0).time_s)
    assert len(later)


def test_a_refined_camera_puts_what_it_saw_where_it_sees_it(tmp_path, walkers):
    site = site_of(tmp_path, [WEST], walkers[:3], refined=["west"])
    before = site_of(tmp_path / "other", [WEST], walkers[:3])
    old, new = before.camera_tracks("west"), site.camera_tracks("west")
    here = CAMERA.project(np.column_stack([old.xy_m, np.zeros(len(old))]))[0]
    there = CAMERA.disturbed(REFINED).locate(here)[0]
    known = np.isfinite(there).all(axis=1)
    assert known.any()
    np.testing.assert_allclose(new.xy_m[known], there[known], atol=1e-9)
    assert site.camera("west").height_m == pytest.approx(5.0 * np.exp(0.03))


def test_regrounding_carries_velocities_and_covariances_along():
    tracks, _ = seen(replace(WEST, middle_m=(0.0, 12.0), radius_m=5.0), strolls(40, 60.0, 14.0))
    before = Calibration.of_camera(CAMERA)
    higher = Calibration.of_camera(CAMERA.disturbed(np.array([0.0, 0.0, 0.0, np.log(1.1), 0.0])))
    moved = regrounded(tracks, before, higher)
    np.testing.assert_allclose(moved.xy_m, 1.1 * tracks.xy_m, rtol=1e-6)
    np.testing.assert_allclose(moved.velocity_mps, 1.1 * tracks.velocity_mps, rtol=1e-4)
    np.testing.assert_allclose(
        moved.covariance_m2, 1.21 * tracks.covariance_m2, rtol=1e-4, atol=1e-6
    )
    np.testing.assert_allclose(moved.heading_rad, tracks.heading_rad, atol=1e-4)


def test_an_undetermined_camera_has_no_tracks_and_says_why(tmp_path, walkers):
    alone = Eye("alone", Placement.undetermined("it shares nobody"), (0.0, 0.0), 5.0)
    tracks, _ = seen(WEST, walkers[:2])
    entry = store(tmp_path / "alone-scene", alone, tracks)
    site = site_of(tmp_path, [WEST], walkers[:3], extra=[("alone", entry)])
    assert site.cameras == ("west",)
    assert site.placements["alone"].reason == "it shares nobody"
    assert "alone" in site._repr_html_()
    with pytest.raises(InputError, match="it shares nobody"):
        site.camera_tracks("alone")
    with pytest.raises(InputError, match="shares nobody"):
        site.camera("alone")


@pytest.mark.parametrize(
    ("path", "value", "word"),
    [
        (("schema",), "scene4d/site/9", "schema"),
        (("start_ns",), 1.5, "start_ns"),
        (("cameras",), {}, "one camera or more"),
        (("cameras", "west", "scale"), -1.0, "greater than 0"),
        (("cameras", "west", "status"), "perhaps", "undetermined"),
        (("cameras", "west", "covariance", "matrix"), [[1.0]], "5x5"),
        (("cameras", "west", "covariance", "matrix"), (-np.eye(5)).tolist(), "negative"),
        (("cameras", "west", "covariance", "parameters"), ["x_m"], "parameters"),
        (("cameras", "west", "runs"), ["r", "r"], "runs"),
        (("cameras", "west", "tracked"), {}, "tracked.r"),
        (("cameras", "west", "tracked", "r", "sha256"), "0", "64 hex"),
        (("anchor",), {"kind": "moon", "residual_m": []}, "kind"),
    ],
)
def test_a_site_file_that_is_wrong_is_refused(site, tmp_path, path, value, word):
    said = json.loads((site.folder / "site.json").read_text())
    inside = said
    for name in path[:-1]:
        inside = inside[name]
    inside[path[-1]] = value
    (tmp_path / "site.json").write_text(json.dumps(said))
    with pytest.raises(InputError, match=word) as error:
        Site.open(tmp_path)
    assert "site.json" in str(error.value)


def test_what_is_no_site_or_has_lost_its_scene_is_named(site, tmp_path):
    with pytest.raises(InputError, match="holds no site"):
        Site.open(tmp_path)
    text = (site.folder / "site.json").read_text().replace('"r"', '"gone"')
    (tmp_path / "site.json").write_text(text.replace("../", f"{site.folder.parent}/"))
    with pytest.raises(InputError, match="gone"):
        Site.open(tmp_path).scene("west")


def test_a_scene_that_was_tracked_again_is_refused_and_one_that_grew_is_not(tmp_path, walkers):
    site = site_of(tmp_path, [WEST], walkers[:2])
    one = site.placed("west")
    run = Run.load(manifest_path(one.scene, "r"))
    assert one.tracked == {"r": run.tracked()}
    more = replace(run.parts[0], path="tracks/more.parquet", sha256="0" * 64)
    hidden = replace(more, path="tracks/.more.parquet")
    for parts, held in (((more,), False), ((*run.parts, more), True), ((*run.parts, hidden), True)):
        manifest = json.dumps(replace(run, parts=parts).to_dict())
        manifest_path(one.scene, "r").write_text(manifest)
        if held:
            assert Site.open(site.folder).scene("west").runs[0].parts == parts
            continue
        with pytest.raises(InputError, match=r"'west' was tracked again .* align again"):
            Site.open(site.folder).scene("west")


def test_an_anchor_is_kept(tmp_path, walkers):
    anchor = SiteAnchor("earth", (0.2, 0.3), 53.44, -0.94)
    assert site_of(tmp_path, [WEST], walkers[:2], anchor=anchor).anchor == anchor


def test_a_site_that_is_written_again_leaves_nothing_of_the_first(tmp_path, walkers):
    first = site_of(tmp_path, [WEST], walkers[:2], refined=["west"])
    assert first.placed("west").camera.exists()
    assert first.placed("west").camera.parent == first.folder / "cameras"
    again = Identities(np.array(["west"]), np.array([1]), np.array([1]), np.array([1.0]))
    west = replace(first.placed("west"), camera=first.scene("west").camera_file("west"))
    write_site(first.folder, SiteFile({"west": west}), again, refined={}, pictures={})
    assert not first.placed("west").camera.exists()
    assert isinstance(Site.open(first.folder).camera("west"), Camera)
    assert len(list(first.folder.glob("*.parquet"))) == 1


class Killed(BaseException):
    """Passes whatever would tidy up, as a kill does."""


def test_killed_anywhere_the_site_is_the_old_one_or_the_new(tmp_path, walkers, monkeypatch):
    def whole(folder):
        site = Site.open(folder)
        told = site.to_dict()["cameras"]["west"]["x_m"], site.calibration("west").camera.height_m
        return *told, site.identities.probability.tolist()

    def make(folder, scene, x_m, height):
        entry = replace(scene, placement=replace(scene.placement, x_m=x_m))
        lens = Calibration.of_camera(CAMERA.disturbed(np.array([0, 0, 0, height, 0])))
        who = Identities(np.array(["west"]), np.array([1]), np.array([1]), np.array([height]))
        pictures = {"plan.png": b"x", "pairs/a.png": b"y"}
        write_site(
            folder, SiteFile({"west": entry}), who, refined={"west": lens}, pictures=pictures
        )

    scene = store(tmp_path / "scene", WEST, seen(WEST, walkers[:2])[0])
    made, seen_ones = tmp_path / "made", []
    make(made, scene, 1.0, 0.1)
    before = whole(made)
    for step in range(40):
        folder = tmp_path / f"s{step}"
        shutil.copytree(made, folder)
        left = iter(range(step))
        with monkeypatch.context() as patch:
            for name in ("replace", "unlink"):
                real = getattr(os, name)

                def change(*args, real=real, left=left, **options):
                    if next(left, None) is None:
                        raise Killed
                    return real(*args, **options)

                patch.setattr(os, name, change)
            try:
                make(folder, scene, 2.0, 0.2)
                killed = False
            except Killed:
                killed = True
        after = whole(folder)
        seen_ones.append(after == before)
        assert after == before or after[0] == 2.0
        assert after[2] == [after[0] / 10]
        make(folder, scene, 3.0, 0.3)
        assert whole(folder)[0] == 3.0
        assert len(list(folder.glob("*.parquet"))) == len(list(folder.glob("cameras/*"))) == 1
        if not killed:
            break
    assert step > 5 and seen_ones[0] and not seen_ones[-1]
