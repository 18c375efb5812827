"""The page of a scene in a real browser: seen, measured, judged, drawn on."""

import base64
import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import expect

from app.pages import click, picture_at
from finding_scenes import ENTERED_S, parked, people, write_scene
from scene4d.app import ViewOptions, view
from scene4d.app._packing import packed
from scene4d.app._page import MODULES, asset, script
from scene4d.core.errors import InputError
from scene4d.formats.scenes._geo import GeoAnchor
from scene4d.searching import SearchOptions, search
from scene4d.store.identities import Identities
from scene4d.store.site import Site
from scene4d.store.site_file import SiteAnchor, SiteFile
from scene4d.store.site_writing import write_site
from site_worlds import CAMERA as CAMERA_OF_WORLDS
from site_worlds import Eye, place, seen, store, strolls
from walks import CAMERA


def test_the_page_opens_from_disk_plays_and_asks_for_no_address(opened, written):
    page = opened.page
    page.goto(written.as_uri())
    assert page.locator("#now").inner_text() == "00:00.0"
    page.keyboard.press(" ")
    expect(page.locator("#now")).to_have_text(re.compile(r"00:0[1-9]"))
    page.keyboard.press(" ")
    stopped = page.locator("#now").inner_text()
    page.keyboard.press("ArrowRight")
    assert page.locator("#now").inner_text() > stopped
    assert {url.partition(":")[0] for url in opened.asked} <= {"file", "blob", "data"}
    assert written.stat().st_size < 15e6


def test_a_click_on_the_timeline_goes_there_and_says_who_is_there(opened, written):
    page = opened.page
    page.goto(written.as_uri())
    line = page.locator("#timeline")
    box = line.bounding_box()
    page.mouse.click(box["x"] + box["width"] * 10 / 29.9, box["y"] + 60)
    assert line.get_attribute("aria-valuetext") == "00:10.0 of 00:29.9, 2 there"
    # The pointer on the person of whom this is known: its box is where the camera sees it.
    walker = next(one for one in people() if one.time_s[0] == 7.0)
    row = int(np.argmin(np.abs(walker.time_s - 10.0)))
    x1, y1, x2, y2 = walker.box_xyxy[row]
    page.mouse.move(*picture_at(page, (x1 + x2) / 2, (y1 + y2) / 2))
    tip = page.locator("#tip").inner_text()
    assert tip.startswith("person 1\n")
    x, y = walker.xy_m[row]
    assert f"{x:.1f}, {y:.1f} m" in tip
    assert "0.14 m" in tip  # 0.1 m along each axis


def test_a_search_is_listed_and_leads_to_its_moment(opened, scene, written):
    page = opened.page
    page.goto(written.as_uri())
    best = search(scene, "two people meet").events[0].event
    page.locator(".event").first.click()
    now = page.locator("#timeline").get_attribute("aria-valuetext")
    assert now.startswith(f"00:{best.begin_s:04.1f}")
    page.keyboard.press("p")
    assert page.locator("#timeline").get_attribute("aria-valuetext") <= now


def test_what_is_measured_in_the_picture_is_what_the_camera_locates(opened, written):
    page = opened.page
    page.goto(written.as_uri())
    page.keyboard.press("m")
    places = [click(page, 200, 330), click(page, 430, 300)]
    xy, valid = CAMERA.locate(places)
    assert valid.all()
    said = page.locator("#marks strong").first.inner_text()
    length, sigma = map(float, re.fullmatch(r"([\d.]+) ± ([\d.]+) m", said).groups())
    assert length == pytest.approx(np.hypot(*(xy[0] - xy[1])), abs=0.006)
    assert 0 < sigma < 0.2  # this camera is exact: what is left is the pointing
    click(page, 320, 400)
    assert "from the camera" in page.locator("#marks li").last.inner_text()
    click(page, 320, 5)  # again on the ground, or not at all: this camera sees no horizon
    assert page.locator("#marks li").count() == 2


def test_a_zone_is_drawn_named_saved_and_searched_in(opened, scene, written, tmp_path):
    page = opened.page
    page.goto(written.as_uri())
    page.keyboard.press("z")
    corners = [(-1.5, 14.0), (2.5, 14.0), (2.5, 18.5), (-1.5, 18.5)]
    uv, _ = CAMERA.project([[*corner, 0.0] for corner in corners])
    for corner in uv:
        click(page, *corner)
    page.keyboard.press("Enter")
    page.locator("#place-name").fill("bay")
    page.keyboard.press("Enter")
    with page.expect_download() as saving:
        page.locator("#places-save").click()
    saving.value.save_as(tmp_path / "zones.json")
    points = json.loads((tmp_path / "zones.json").read_text())["zones"]["bay"]["points"]
    assert np.abs(np.array(points) - corners).max() < 0.15  # a pixel of the screen
    found = search(
        scene, "a person enters the zone bay", SearchOptions(zones=tmp_path / "zones.json")
    )
    assert len(found) == 1
    assert 7 < found.events[0].event.begin_s < ENTERED_S


def test_another_horizon_is_tried_and_gives_the_file_to_calibrate_with(opened, written, tmp_path):
    from scene4d.core.orientation import Orientation

    page = opened.page
    page.goto(written.as_uri())
    page.keyboard.press("j")
    page.locator("#try-tilt").fill("18.5")
    page.locator("#try-roll").fill("1.5")
    assert "--orientation orientation.json" in page.locator("#tried-command").inner_text()
    with page.expect_download() as saving:
        page.locator("#try-save").click()
    saving.value.save_as(tmp_path / "orientation.json")
    guess = Orientation.load(tmp_path / "orientation.json")
    assert np.degrees([guess.tilt_rad, guess.roll_rad]) == pytest.approx([18.5, 1.5])
    assert guess.focal_px == pytest.approx(CAMERA.focal_px)


def test_layers_tracks_and_keys(opened, written):
    page = opened.page
    page.goto(written.as_uri())
    for key in "123456789":
        page.keyboard.press(key)
    pressed = page.locator("#layers [aria-pressed=true]").all_inner_texts()
    shown = "Cuboids, Uncertainty, Ground grid, Horizon, Heat map, Uprights, Plan photo"
    assert ", ".join(pressed) == shown
    page.locator("#tab-tracks").click()
    assert page.locator("#tracks-count").inner_text() == "5 of 5 tracks"
    page.locator("#filter-kind").select_option("person")
    assert page.locator("#tracks-count").inner_text() == "4 of 5 tracks"
    page.locator("#filter-path").fill("9")
    assert page.locator("#tracks-count").inner_text() == "0 of 5 tracks"
    page.locator("#help").click()
    assert "play or pause" in page.locator("#helping").inner_text()


def test_numbers_are_packed_within_the_error_that_is_stated():
    values = np.array([-3.2, np.nan, 17.25, 0.0])
    column = packed({"x": values})["x"]
    codes = np.frombuffer(base64.b64decode(column["codes"]), "<u2")
    back = np.where(codes == 65_535, np.nan, column["offset"] + column["scale"] * codes)
    assert np.array_equal(np.isnan(back), np.isnan(values))
    assert 0 < np.nanmax(np.abs(back - values)) <= column["error"] < 2e-4


HOSTILE = "</script><img src=x onerror=alert(1)>'\"&\u2028"


def test_hostile_names_stay_words(opened, tmp_path):
    words = {"source": f"{HOSTILE}.mp4", "rate_hz": 10}
    folder = write_scene(tmp_path / "s", [parked()], camera=HOSTILE, run=HOSTILE, provenance=words)
    write_scene(folder, people(), camera="<b>other</b>", run="<i>", provenance=words)
    (tmp_path / "z.json").write_text(json.dumps({"zones": {HOSTILE: [[0, 9], [3, 9], [3, 12]]}}))
    options = ViewOptions(zones=tmp_path / "z.json")
    page = opened.page
    page.on("dialog", lambda dialog: pytest.fail(dialog.message))
    page.goto(view([folder], tmp_path / "page.html", options).as_uri())
    assert f"{HOSTILE}, {HOSTILE}" in page.locator("#run-choice").text_content()
    page.locator("#tab-places").click()
    assert page.locator("#places .name").text_content() == HOSTILE
    page.locator("#run-choice").select_option("1")
    assert "no longer at" in page.locator("#note").inner_text()
    assert page.locator("img").count() == 0


def test_a_page_that_cannot_be_made_says_why(scene, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no-such does not exist"):
        ViewOptions(footage=tmp_path / "no-such")
    monkeypatch.setattr("scene4d.app.viewing._MOST_ROWS", 100)
    with pytest.raises(InputError, match=r"more than the 100 of a page; serve it"):
        view([scene], tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


def test_modules_import_what_others_export():
    """They are put together in one script, in which nothing would say that a name is missing."""
    code = script()
    assert "import {" not in code
    for name in MODULES:
        text = asset(f"{name}.js")
        for wanted, other in re.findall(r'^import \{([^}]*)\} from "\./(\w+)\.js";$', text, re.M):
            exported = asset(f"{other}.js")
            for one in map(str.strip, wanted.split(",")):
                assert re.search(rf"^export [a-z* ]*{re.escape(one)}\W", exported, re.M), one


def test_the_cameras_of_a_site_share_a_plan_and_a_clock(opened, tmp_path):
    west = Eye("west", place(0.0, 0.0, 0.0), (-4.0, 0.0), 12.0, noise_m=0.05, shared_m=0.0)
    east = Eye("east", place(30.0, 4.0, 160.0, 1.05, 7.3), (4.0, 0.0), 12.0, 0.05, 0.0)
    walkers = strolls(4, 40.0, 8.0)
    cameras, rows = {}, []
    for eye in (west, east):
        tracks, whose = seen(eye, walkers)
        cameras[eye.name] = store(tmp_path / eye.name, eye, tracks, None)
        rows += [(eye.name, number, who + 1, 1.0) for number, who in whose.items()]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    identities = Identities(*columns)
    anchor = SiteAnchor("earth", (0.4, 0.5), 52.4, 179.99995)
    write_site(
        tmp_path / "site", SiteFile(cameras, anchor=anchor), identities, refined={}, pictures={}
    )
    page = opened.page
    page.goto(view([tmp_path / "site"], tmp_path / "page.html").as_uri())
    box = page.locator("#timeline").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 60)
    moment = page.locator("#now").inner_text()
    page.locator("#run-choice").select_option("1")
    assert page.locator("#now").inner_text() == moment
    # The east camera's page shows its tracks where the site has them.
    site = Site.open(tmp_path / "site")
    expected = site.camera_tracks("east", keypoints=False)
    said = json.loads(page.locator("#data").text_content())
    shown = rows_shown(said["runs"][1]["data"])
    assert np.abs(shown - expected.xy_m).max() < 0.002
    # On the plan everybody stands once, unless each camera's own is asked for.
    assert np.abs(rows_shown(said["fused"]) - site.tracks().xy_m).max() < 0.002
    page.mouse.move(*picture_at(page, 120, 160, CAMERA_OF_WORLDS.image_size))
    tip = page.locator("#tip").inner_text()
    assert re.search(r"Seen by\n(west|east|west, east)\n", tip), tip
    camera = site.camera("east")
    assert np.allclose(said["cameras"]["east"]["R"], camera.R)
    # A click says where on the Earth that is: beyond 180 degrees east here.
    page.keyboard.press("m")
    x, y = picture_at(page, 640, 500, CAMERA_OF_WORLDS.image_size)
    page.mouse.click(x, y)
    (xy,), _ = camera.locate([(640, 500)])
    lon, lat = GeoAnchor.at(52.4, 179.99995).to_lonlat(xy[None])[0]
    told = page.locator("#marks .earth").inner_text()
    found = re.search(r"Latitude ([-\d.]+)° ± ([\d.]+) m\nLongitude ([-\d.]+)° ±", told)
    pixel = 0.4 * 9e-6  # the click is a whole pixel of the screen
    assert float(found[1]) == pytest.approx(lat, abs=pixel)
    assert float(found[3]) == pytest.approx(lon, abs=2 * pixel)
    assert page.get_by_role("button", name="Copy").is_visible()


def rows_shown(rows: dict) -> np.ndarray:
    """Positions of packed rows, unpacked as the page's script does."""
    found = []
    for name in ("x_m", "y_m"):
        column = rows["columns"][name]
        codes = np.frombuffer(base64.b64decode(column["codes"]), "<u2")
        found.append(column["offset"] + column["scale"] * codes)
    return np.column_stack(found)


def test_tracks_are_kept_by_zone_and_time_and_events_are_saved(opened, scene, tmp_path):
    (tmp_path / "z.json").write_text(
        json.dumps({"zones": {"bay": [[-1.5, 14], [2.5, 14], [2.5, 18.5], [-1.5, 18.5]]}})
    )
    options = ViewOptions(searches=["two people meet"], zones=tmp_path / "z.json", video=False)
    page = opened.page
    page.goto(view([scene], tmp_path / "page.html", options).as_uri())
    page.locator("#tab-tracks").click()
    page.locator("#filter-zone").select_option("bay")
    assert page.locator("#tracks-body th").all_inner_texts() == ["person 1", "car 9"]
    page.locator("#filter-lasting").fill("20")
    assert page.locator("#tracks-body th").all_inner_texts() == ["car 9"]
    page.locator("#tab-events").click()
    with page.expect_download() as saving:
        page.get_by_role("button", name="Save CSV").click()
    saving.value.save_as(tmp_path / "events.csv")
    table = pd.read_csv(tmp_path / "events.csv")
    found = search(scene, "two people meet")
    assert table["begin_s"].tolist() == [one.event.begin_s for one in found.events]
    assert set(found.events[0].event.roles) < set(table.columns)


@pytest.mark.parametrize("line", ["{", "[1]", '{"id": "a"}', '{"id": "a", "roles": 3}', "[" * 9999])
def test_what_watch_did_not_write_is_no_event(scene, tmp_path, line):
    folder = shutil.copytree(scene, tmp_path / "scene")
    (folder / "events").mkdir()
    (folder / "events" / "morning.jsonl").write_text(f"{line}\n")
    with pytest.raises(InputError, match=r"morning.jsonl: line 1: no event"):
        view([folder], tmp_path / "page.html", ViewOptions(video=False))
