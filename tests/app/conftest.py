"""A real browser, and a scene that is shown in it."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from finding_scenes import parked, people, write_scene
from scene4d.app import ViewOptions, view
from walks import write_video

_PATIENCE_MS = 60_000
"""A busy machine is no failure."""
expect.set_options(timeout=_PATIENCE_MS)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium without a window; skipped with one sentence where there is none."""
    found = shutil.which("chromium", path="/usr/bin:/usr/local/bin:/snap/bin")
    if found is None:
        pytest.skip("no browser: apt-get install chromium")
    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=found, args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of people around a parked car, with footage of its beginning."""
    folder = tmp_path_factory.mktemp("app")
    footage = write_video(folder / "gate.mp4", seconds=6, codec="libx264")
    rows = [*people(), parked()]
    return write_scene(folder / "scene", rows, provenance={"source": str(footage), "rate_hz": 10})


@pytest.fixture(scope="session")
def written(scene: Path) -> Path:
    """The page of the scene, with a search."""
    options = ViewOptions(searches=["two people meet"])
    return view([scene], scene.parent / "page.html", options)


class Watched:
    """A page, and what it complained about or asked for."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.asked: list[str] = []
        page.on("console", lambda said: self._hear(said.type, said.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))

    def _hear(self, kind: str, text: str) -> None:
        if kind in ("error", "warning"):
            self.complaints.append(text)


@pytest.fixture
def opened(browser: Browser) -> Iterator[Watched]:
    """A page of 1280 x 800; at the end nothing has been complained about."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(_PATIENCE_MS)
    watched = Watched(page)
    yield watched
    page.close()
    assert watched.complaints == []
