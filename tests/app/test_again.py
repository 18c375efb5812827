"""A camera that is calibrated again from the page: its file beside, cancelled, refused."""

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from app.pages import picture_at
from app.serving_tests import Running
from cli_scenes import mot_text
from cli_scenes import people as boxes_of
from finding_scenes import people, write_scene
from scene4d.core.calibration import Calibration
from walks import CAMERA, write_video

ORIENTATION = {
    "focal_px": 600.0, "tilt_deg": 20.05, "roll_deg": 0.57,
    "sigma": {"focal_px": 18.0, "tilt_deg": 0.5, "roll_deg": 0.5},
}  # fmt: skip


@pytest.fixture(scope="module")
def judged(tmp_path_factory) -> Iterator[tuple[Running, Path]]:
    """Of a scene whose people were annotated, so that no network is needed to find them."""
    folder = tmp_path_factory.mktemp("again")
    (folder / "boxes.txt").write_text(mot_text(boxes_of(CAMERA)))
    video = write_video(folder / "gate.mp4", seconds=2, codec="libx264")
    made = {"source": str(video), "annotations": str(folder / "boxes.txt"), "rate_hz": 10}
    one = Running(write_scene(folder / "scene", people(), provenance=made))
    yield one, folder / "scene"
    one.close()


def ended(running: Running) -> dict:
    until_s = time.monotonic() + 60
    while time.monotonic() < until_s:
        state = json.loads(running.ask("GET", "/api/calibration")[2])
        if state["state"] != "running":
            return state
        time.sleep(0.1)
    raise AssertionError("it does not end")


def test_the_page_runs_it_and_shows_the_new_camera_beside_the_old_one(judged, opened):
    running, scene = judged
    before = (scene / "cameras" / "gate.json").read_bytes()
    page = opened.page
    page.goto(f"{running.url}/")
    page.locator("#tab-camera").click()
    page.locator("#try-tilt").fill("20.2")
    page.locator("#tried-run").click()
    expect(page.locator("#again-cancel")).to_be_visible()
    assert running.post("/api/runs/0/calibration", {"orientation": ORIENTATION})[0] == 429
    expect(page.locator("#again-said")).to_contain_text("judged/gate-1/camera.json")
    state = ended(running)
    found = Calibration.load(scene / state["file"])
    assert found.camera.height_m == pytest.approx(5.0, abs=0.25)
    assert state["camera"]["ground_error_m"]["median"] > 0
    assert (scene / "cameras" / "gate.json").read_bytes() == before
    rows = page.locator("#again-table tbody tr").all_inner_texts()
    height = next(row.split("\t") for row in rows if row.startswith("Height"))
    assert height[1].startswith("5.00 ±")
    assert height[2].startswith(f"{found.camera.height_m:.2f} ±")


def test_a_dragged_upright_is_a_landmark(judged, opened):
    page = opened.page
    page.goto(f"{judged[0].url}/")
    page.keyboard.press("j")
    foot, head = (picture_at(page, *CAMERA.project([[1.0, 12.0, z]])[0][0]) for z in (0, 2.1))
    page.mouse.move(*foot)
    page.mouse.down()
    page.mouse.move(*head, steps=3)
    page.mouse.up()
    assert float(page.locator("#marks strong").inner_text().split()[0]) == pytest.approx(
        2.1, abs=0.05
    )
    page.get_by_label("True height").fill("2.00")
    with page.expect_request("**/calibration") as sent:
        page.locator("#known-run").click()
    (upright,) = sent.value.post_data_json["landmarks"]["uprights"]
    assert upright["height_m"] == 2.0
    assert CAMERA.locate([upright["foot_uv"]])[0][0] == pytest.approx([1, 12], abs=0.3)
    page.locator("#again-cancel").click()
    expect(page.locator("#again")).to_be_hidden()


def test_it_is_cancelled_and_what_is_wrong_is_said(judged):
    running, scene = judged
    made = sorted((scene / "judged").glob("*"))
    assert running.post("/api/runs/0/calibration", {"orientation": ORIENTATION})[0] == 202
    assert json.loads(running.ask("DELETE", "/api/calibration")[2]) == {"state": "none"}
    for known, text in (
        ({"orientation": ORIENTATION | {"focal_px": "wide"}}, "orientation.json: field 'focal_px'"),
        ({"landmarks": {"points": "none"}}, "landmarks.json: field 'points'"),
    ):
        assert running.post("/api/runs/0/calibration", known)[0] == 202
        state = ended(running)
        assert (state["state"], state["error"]["kind"]) == ("failed", "input")
        assert state["error"]["message"].startswith(text)
    for known in ({}, {"orientation": "/etc/passwd"}, {"lens": {}}, {"source": {}}):
        assert running.post("/api/runs/0/calibration", known)[0] == 400
    assert running.post("/api/runs/7/calibration", {"orientation": ORIENTATION})[0] == 404
    assert sorted((scene / "judged").glob("*")) == made
