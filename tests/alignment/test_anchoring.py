"""A site tied to the Earth, to a plan or to known cameras, with errors as large as it says."""

import json
from dataclasses import replace

import numpy as np
import pytest

from alignment.maps import tie
from scene4d.alignment._anchors import Anchored
from scene4d.cli.exporting import export_site
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.placement import Placement
from scene4d.formats.anchors import Anchors
from scene4d.store.identities import Identities
from scene4d.store.site import Site
from scene4d.store.site_file import SiteAnchor, SiteFile
from scene4d.store.site_writing import write_site
from site_worlds import CAMERA, NOON, Eye, place, seen, store, strolls

KNOWN = Calibration.of_camera(CAMERA)
WORLD = place(400.0, -250.0, 75.0, 1.03)
"""Where the site's frame lies in the anchors'."""
FIRST, SECOND = place(0.0, 0.0, 0.0), place(12.0, 20.0, 160.0, 1.0, 3.0)


def cameras(**changed) -> dict[str, Anchored]:
    found = {
        "west": Anchored(KNOWN, FIRST, None, True),
        "east": Anchored(KNOWN, SECOND, None, False),
    }
    return {name: replace(one, **changed.get(name, {})) for name, one in found.items()}


def points(rng, names=("west", "west", "west", "east", "east"), sigma=0.2, kind="plan") -> Anchors:
    """Pixels on the ground, and where they are in the world, read with an error."""
    at = {"west": FIRST, "east": SECOND}
    xy = rng.uniform([-4, 6], [4, 16], (len(names), 2))
    uv = CAMERA.project(np.column_stack([xy, np.zeros(len(xy))]))[0]
    true = [WORLD.points(at[name].points(p[None]))[0] for name, p in zip(names, xy, strict=True)]
    return Anchors(kind, tuple(names), uv, np.array(true) + rng.normal(0, sigma, (len(names), 2)))


def test_the_frame_becomes_that_of_the_anchors_as_well_as_it_says():
    ratio, inside = [], 0
    for seed in range(40):
        found, anchor, _ = tie(cameras(), points(np.random.default_rng(seed)))
        expected = SECOND.then(WORLD)
        apart = (found["east"].parameters - expected.parameters)[:4]
        apart[2] = np.angle(np.exp(1j * apart[2]))
        covariance = found["east"].covariance[:4, :4]
        q = apart @ np.linalg.solve(covariance, apart)
        ratio.append(q / 4)
        inside += q < 9.49
        assert anchor.kind == "plan" and len(anchor.residual_m) == 5
        assert found["east"].time_offset_s == 3.0
    assert 0.4 < np.mean(ratio) < 1.4
    assert inside >= 36


def test_a_known_camera_is_an_anchor():
    tracks, _ = seen(Eye("west", FIRST, (0.0, 11.0), 6.0, 0.05), strolls(30, 60.0, 12.0))
    there = FIRST.then(replace(WORLD, scale=1.0)).camera(CAMERA)
    found, anchor, _ = tie(
        cameras(west={"tracks": tracks}), Anchors("cameras", known={"west": there})
    )
    assert anchor.kind == "cameras"
    np.testing.assert_allclose(
        found["west"].points(np.zeros((1, 2)))[0], there.centre_m[:2], atol=0.05
    )
    assert found["west"].heading_rad == pytest.approx(np.radians(75.0), abs=0.01)
    assert found["east"]


def test_a_camera_that_shares_nobody_is_placed_by_its_own_points_if_its_clock_is_known():
    alone = Placement.undetermined("it shares nobody")
    rng = np.random.default_rng(3)
    found, *_ = tie(cameras(west={"placement": alone}), points(rng))
    assert found["west"] and found["east"]
    np.testing.assert_allclose(found["west"].parameters[:2], WORLD.parameters[:2], atol=1.0)
    assert found["west"].sigma["time_offset_s"] == pytest.approx(1.0)
    unknown, *_ = tie(cameras(west={"placement": alone, "start_known": False}), points(rng))
    assert not unknown["west"] and "clock is not known" in unknown["west"].reason


def test_anchors_that_cannot_be_right_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="no camera 'nort'"):
        tie({"north": cameras()["west"]}, replace(points(rng), camera=("nort",) * 5))
    with pytest.raises(InputError, match="two or more"):
        tie(cameras(), points(rng, ("west",)))
    wrong = points(rng, ("west",) * 6)
    wrong.xy_m[2] += 15.0
    with pytest.raises(InputError, match="does its place belong"):
        tie(cameras(), wrong)
    with pytest.raises(InputError, match="does not lie on the ground"):
        tie(cameras(), replace(points(rng), uv=np.full((5, 2), -900.0)))


def site_of(folder, anchor) -> Site:
    eye = Eye("west", FIRST, (0.0, 11.0), 6.0, 0.05)
    tracks, whose = seen(eye, strolls(6, 60.0, 12.0))
    entry = store(folder / "scene", eye, tracks, NOON)
    names = np.array(["west"] * len(whose))
    track, number = np.array(list(whose)), np.array(list(whose.values())) + 1
    known = Identities(names, track, number, np.ones(len(whose)))
    said = SiteFile({"west": entry}, int(NOON.timestamp()) * 10**9, anchor)
    write_site(folder / "site", said, known, refined={}, pictures={})
    return Site.open(folder / "site")


def test_a_whole_site_on_the_map(tmp_path):
    site = site_of(tmp_path, SiteAnchor("earth", (), 53.44, -0.94))
    (file,) = export_site(site.folder, tmp_path / "people.geojson", "geojson")
    features = json.loads(file.read_text())["features"]
    assert {one["properties"]["track"] for one in features} == set(site.tracks().track.tolist())
    lon, lat = np.array(features[0]["geometry"]["coordinates"])[0]
    first = site.tracks(tracks=[features[0]["properties"]["track"]])
    assert (lat - 53.44) * 111_300 == pytest.approx(first.xy_m[0, 1], abs=0.1)
    assert (lon + 0.94) * 66_450 == pytest.approx(first.xy_m[0, 0], abs=0.1)
    assert features[0]["properties"]["start"].startswith("2026-11-20T12:0")


def test_what_a_site_cannot_be_written_as_is_told(tmp_path):
    site = site_of(tmp_path, None)
    with pytest.raises(InputError, match="align it again with an anchor"):
        export_site(site.folder, tmp_path / "x", "geojson")
    with pytest.raises(InputError, match="boxes in the picture of one camera"):
        export_site(site.folder, tmp_path / "x", "mot")
    (file,) = export_site(site.folder, tmp_path / "x.csv", "csv")
    assert len(file.read_text().splitlines()) == len(site.tracks()) + 1
