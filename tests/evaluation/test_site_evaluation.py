"""A site against its truth: errors that were put in come out, and a perfect site has none."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from scene4d.cli.app import app
from scene4d.core.errors import InputError
from scene4d.core.placement import Placement
from scene4d.core.progress import Silent
from scene4d.evaluation import evaluate_site
from scene4d.evaluation.measures._site import true_placement
from scene4d.evaluation.pages.site import draw_site
from scene4d.formats.cameras import write_camera
from scene4d.store.identities import Identities
from scene4d.store.site_file import SiteFile
from scene4d.store.site_writing import write_site
from site_worlds import CAMERA, Eye, place, seen, store, strolls

WEST = Eye("cam0", place(0.0, 0.0, 0.0), (0.0, 11.0), 6.0, 0.05)
EAST = Eye("cam2", place(12.0, 18.0, 160.0), (6.0, 11.0), 8.0, 0.05)
WORLD = place(40.0, -25.0, 75.0)
"""Where the site's frame lies in the world of the true cameras."""


def errors_put_in(x=0.0, y=0.0, heading_deg=0.0, offset_s=0.0, sigma=0.1) -> Placement:
    true = EAST.placement
    return Placement(
        true.x_m + x,
        true.y_m + y,
        true.heading_rad + float(np.radians(heading_deg)),
        1.0,
        offset_s,
        np.diag([sigma**2, sigma**2, 0.02**2, 0.0, 0.1**2]),
    )


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    walkers, entries, rows = strolls(12, 60.0, 10.0), {}, []
    for eye in (WEST, EAST):
        tracks, whose = seen(eye, walkers)
        entries[eye.name] = store(folder / eye.name, eye, tracks)
        rows += [(eye.name, track, who + 1, 1.0) for track, who in whose.items()]
        world = eye.placement.then(WORLD).camera(CAMERA)
        write_camera(world, folder / f"{eye.name[-1]}.krtd", "krtd")
    return folder, entries, Identities(*(np.array(c) for c in zip(*rows, strict=True)))


def site_with(scenes, placement: Placement, name: str):
    folder, entries, known = scenes
    there = entries | {"cam2": replace(entries["cam2"], placement=placement)}
    write_site(folder.parent / name, SiteFile(there), known, refined={}, pictures={})
    return folder, folder.parent / name


def test_the_ground_of_a_true_camera_is_where_it_looks():
    for eye in (WEST, EAST):
        placement = eye.placement.then(WORLD)
        found = true_placement(placement.camera(CAMERA))
        np.testing.assert_allclose(found.parameters[:3], placement.parameters[:3], atol=1e-9)


def test_a_perfect_site_has_no_error(scenes):
    found = evaluate_site(*site_with(scenes, errors_put_in(), "right"), Silent())
    (pair,) = found.pairs
    assert (
        pair.position_error_m < 1e-3
        and pair.heading_error_deg < 1e-3
        and pair.offset_error_s < 1e-9
    )
    assert pair.pose_within_95 and pair.offset_within_95
    assert found.people.people > 2 and np.median(found.people.distance_m) < 0.2
    assert found.ground.site_m < 0.01 and found.ground.refined_m == pytest.approx(
        found.ground.alone_m
    )
    assert set(found.aligned) == {"cam0", "cam2"}
    near = found.aligned["cam2"].centre_m[:2] - [12.0, 18.0]
    np.testing.assert_allclose(near, 0.0, atol=1e-3)


def test_errors_that_are_put_in_come_out(scenes):
    wrong = errors_put_in(0.3, -0.4, 2.0, 0.5)
    found = evaluate_site(*site_with(scenes, wrong, "wrong"), Silent())
    (pair,) = found.pairs
    assert pair.position_error_m == pytest.approx(0.5, abs=1e-3)
    assert pair.heading_error_deg == pytest.approx(2.0, abs=1e-3)
    assert pair.offset_error_s == pytest.approx(0.5)
    assert pair.position_sigma_m == pytest.approx(np.hypot(0.1, 0.1))
    assert not pair.pose_within_95 and not pair.offset_within_95
    assert found.ground.site_m > 0.05
    unsure = evaluate_site(*site_with(scenes, errors_put_in(0.3, sigma=0.4), "unsure"), Silent())
    assert unsure.pairs[0].pose_within_95


def test_offsets_that_are_known_are_taken_off(scenes, tmp_path):
    folder, site = site_with(scenes, errors_put_in(offset_s=7.3), "late")
    path = folder / "offsets.json"
    path.write_text(json.dumps({"cam0": 0.0, "cam2": 7.25}))
    try:
        (pair,) = evaluate_site(folder, site, Silent()).pairs
    finally:
        path.unlink()
    assert pair.offset_error_s == pytest.approx(0.05)


def test_the_command_writes_the_page(scenes, tmp_path):
    folder, site = site_with(scenes, errors_put_in(0.2), "page")
    words = ["evaluate", "site", "--data", folder, "--site", site, "--out", tmp_path / "score"]
    done = CliRunner().invoke(app, [str(word) for word in words] + ["--json"])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["schema"] == "scene4d/evaluate site/1" and len(said["pairs"]) == 1
    assert said["people"]["median_m"] < 0.5
    page = (tmp_path / "score" / "evaluation.html").read_text()
    assert "cam0 and cam2" in page and "true camera" in page
    assert (tmp_path / "score" / "figures" / "site_plan.png").exists()
    plain = CliRunner().invoke(app, [str(word) for word in words[:-2]])
    assert "positions are off by 0.20 m" in " ".join(plain.stdout.split())


def test_figures_need_no_scenes_any_more(scenes):
    """Scenes made of videos lie in a folder that is gone by then."""
    folder, site = site_with(scenes, errors_put_in(0.2), "gone")
    found = evaluate_site(folder, site, Silent())
    elsewhere = folder.rename(folder.with_name("elsewhere"))
    try:
        assert set(draw_site(found)) == {"site_plan", "site_people"}
    finally:
        elsewhere.rename(folder)


def test_without_truth_or_site_it_says_so(scenes, tmp_path):
    _, site = site_with(scenes, errors_put_in(), "none")
    with pytest.raises(InputError, match="true cameras of 0"):
        evaluate_site(tmp_path, site, Silent())
    with pytest.raises(InputError, match="no site, no scenes and no videos"):
        evaluate_site(tmp_path, None, Silent())
    with pytest.raises(InputError, match="is no folder"):
        evaluate_site(tmp_path / "gone", None, Silent())
