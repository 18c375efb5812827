"""A real ``watch`` beside a real ``serve``: what it sees comes into the page by itself."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.request import urlopen

import pytest
from playwright.sync_api import expect

from app.pages import violations
from finding_scenes import people, write_scene
from scene4d.store.query import Scene
from scene4d.store.status import Status
from walks import CAMERA, write_video

HERE = Path(__file__).parents[1]
WATCH = """
import sys
sys.path[:0] = sys.argv[1:3]
from conftest import Perfect, play_endless
import scene4d.perception.objects as objects, scene4d.calibration.watching as watching
objects.ObjectDetector.default = lambda **_: Perfect()
watching.fetch_weights = lambda *_, **__: None
import time
from scene4d.video.live import LiveSource
LiveSource._play = play_endless
look = Perfect.look
Perfect.look = lambda self, frame: (time.sleep(0.1 * (frame.index > 30)), look(self, frame))[1]
from scene4d.cli import main
sys.argv = ["scene4d", "watch", *sys.argv[3:]]
main()
"""
"""The command with a detector that knows the answer: two people and a car, until it is ended."""


@pytest.fixture
def served(tmp_path) -> Iterator[str]:
    """The address of ``scene4d serve`` of an empty folder, as soon as it is told."""
    (tmp_path / "scene").mkdir()
    words = ["serve", str(tmp_path / "scene"), "--port", "0"]
    code = [sys.executable, "-c", "from scene4d.cli import main; main()"]
    with subprocess.Popen([*code, *words], stderr=subprocess.PIPE, text=True) as serving:
        try:
            yield serving.stderr.readline().partition("serving at ")[2].split()[0]
        finally:
            serving.send_signal(signal.SIGINT)
            serving.communicate(timeout=30)
    assert serving.returncode in (0, 130)


def test_a_camera_that_is_watched_comes_into_the_page_by_itself(opened, tmp_path, served):
    """First the scene is empty; then it has one recorded camera, and then a watched one."""
    with urlopen(f"{served}api/scene") as answer:  # accepted as soon as it is told
        assert json.load(answer)["runs"] == []
    page, scene = opened.page, tmp_path / "scene"
    page.goto(served)
    expect(page.locator("#live")).to_have_attribute("data-state", "connected")
    expect(page.locator("#fleet-said")).to_contain_text("Nobody was tracked yet")
    assert violations(page) == []
    write_scene(scene, people(), provenance={"rate_hz": 10})
    expect(page.locator("#run-choice option")).to_have_count(1)
    CAMERA.save(tmp_path / "camera.json")
    video = write_video(tmp_path / "yard.avi", seconds=1)
    words = ["--camera", "camera.json", "--out", str(scene), "--name", "yard", "--search"]
    expect(page.locator("#live")).to_have_attribute("data-state", "connected")
    assert page.locator("#fleet-toggle").is_hidden()  # one camera
    places = [str(HERE / "tracking"), str(HERE), str(video), *words, "a person walks"]
    command = [sys.executable, "-c", WATCH, *places]
    with subprocess.Popen(command, cwd=tmp_path) as watching, ExitStack() as ending:
        ending.callback(watching.kill)  # else a failure waits for it, and it never ends
        expect(page.locator("#run-choice option")).to_have_count(2)
        page.keyboard.press("c")
        tile = page.locator(".tile[data-camera=yard]")
        expect(tile.locator(".state")).to_have_text("live")
        assert page.locator(".tile[data-camera=gate] .state").inner_text() == "recording"
        assert violations(page) == []
        tile.focus()
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        expect(page.locator("#tracks-count")).to_have_text("3 of 3 tracks")
        early = float(page.locator("#timeline").get_attribute("aria-valuemax"))
        assert watching.poll() is None, "they came while it was watched"
        watching.send_signal(signal.SIGTERM)
        assert watching.wait(30) == 0
    expect(page.locator(".event").first).to_contain_text("person")
    page.keyboard.press("c")
    expect(tile.locator(".state")).to_have_text("ended")
    assert float(page.locator("#timeline").get_attribute("aria-valuemax")) > early
    rows = next(run.rows for run in Scene.open(scene).runs if run.camera == "yard")
    minutes = float(tile.locator(".rates, .soft").first.inner_text().split()[0].replace(",", ""))
    assert minutes > 0.9 * rows
    assert Status.load(scene, "yard").state == "ended"
    page.goto("about:blank")  # else it tries again, and complains that nobody answers
