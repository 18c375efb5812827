"""Make the pictures of docs/view.md from a scene in a headless Chromium, after ``scene4d demo``.

python docs/make_view_pictures.py scene4d-demo/scene
"""

import shutil
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from scene4d.app import ViewOptions, view

IMAGES = Path(__file__).parent / "images"
WORDS = "two people meet"
SECONDS = 12
"""Where the pictures are taken: many are there."""


def seek(page: Page, seconds: int) -> None:
    for _ in range(seconds):
        page.keyboard.press("Shift+ArrowRight")
    page.wait_for_timeout(800)


def at(page: Page, pane: str, x: float, y: float) -> tuple[float, float]:
    """A place on the screen by its share of a pane's width and height."""
    box = page.locator(f"#{pane}").bounding_box()
    assert box is not None
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def look(page: Page) -> None:
    page.locator(".event").first.click()
    page.locator(".events summary").first.click()
    page.wait_for_timeout(800)


def everything(page: Page) -> None:
    seek(page, SECONDS)
    for key in "45f":
        page.keyboard.press(key)
    page.locator("#tab-tracks").click()


def small(page: Page) -> None:
    seek(page, SECONDS)


def measure(page: Page) -> None:
    page.keyboard.press("m")
    for place in ((0.22, 0.72), (0.80, 0.60)):
        page.mouse.click(*at(page, "picture", *place))
    page.mouse.move(*at(page, "plan", 0.2, 0.9))


def judge(page: Page) -> None:
    seek(page, SECONDS)
    for key in "j69":
        page.keyboard.press(key)
    page.mouse.move(*at(page, "picture", 0.5, 0.62))


PICTURES = (
    ("view-1280", (1280, 800), "light", look),
    ("view-2560", (2560, 1440), "dark", everything),
    ("view-400", (400, 1500), "light", small),
    ("view-measure", (1280, 800), "light", measure),
    ("view-judge", (1280, 800), "dark", judge),
)


def take(browser: Browser, page_uri: str, name: str, size: tuple, theme: str, act) -> None:
    width, height = size
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=theme)
    page.goto(page_uri)
    page.wait_for_timeout(1500)
    act(page)
    page.wait_for_timeout(5000 if act is measure else 500)
    pixels = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(IMAGES / f"{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, 80])
    page.close()


def main() -> None:
    found = shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        page = view([sys.argv[1]], Path(folder) / "page.html", ViewOptions(searches=[WORDS]))
        browser = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        for name, size, theme, act in PICTURES:
            take(browser, page.as_uri(), name, size, theme, act)
        browser.close()


if __name__ == "__main__":
    main()
