"""The page for everybody: axe finds nothing, keys alone suffice, in any width, light and dark."""

import pytest

from app.pages import click, picture_at, violations
from walks import CAMERA


@pytest.mark.parametrize(("theme", "width"), [("light", 400), ("dark", 2560)])
def test_axe_finds_nothing_and_nothing_is_cut_off(opened, written, theme, width):
    page = opened.page
    page.emulate_media(color_scheme=theme)
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(written.as_uri())
    for tab in ("events", "tracks", "measure", "places", "camera"):
        page.locator(f"#tab-{tab}").click()
        if tab == "measure":
            page.keyboard.press("m")
            click(page, 300, 400)
        assert violations(page) == [], tab
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.locator("#help").click()
    assert violations(page) == []


def test_the_ruler_can_be_used_with_keys_alone(opened, written):
    page = opened.page
    page.goto(written.as_uri())
    page.keyboard.press("m")
    page.locator("#picture").focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    for _ in range(5):
        page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("Enter")
    x0, y0 = picture_at(page, 0, 0)
    scale = picture_at(page, 1, 0)[0] - x0
    box = page.locator("#picture").bounding_box()
    middle = (box["x"] + box["width"] / 2 - x0, box["y"] + box["height"] / 2 + 4 - y0)
    ends = [(middle[0] / scale, middle[1] / scale), ((middle[0] + 100) / scale, middle[1] / scale)]
    xy, _ = CAMERA.locate(ends)
    length = ((xy[0] - xy[1]) ** 2).sum() ** 0.5
    said = page.locator("#marks strong").first.inner_text()
    assert float(said.partition(" ")[0]) == pytest.approx(length, abs=0.02)
    assert "Length" in page.locator("#said").inner_text()
