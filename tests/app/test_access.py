"""The page for everybody: names for what can be used, contrast, keys alone, widths and themes."""

import pytest

from app.pages import picture_at
from walks import CAMERA

# What a screen reader is told of each thing that can be used and is visible, and each text's
# contrast with what is behind it (WCAG 2.2, 1.4.3), as both are computed by the browser.
NAMES = """() => [...document.querySelectorAll('button, input, select, [tabindex], summary')]
  .filter((one) => one.checkVisibility())
  .filter((one) => !(one.getAttribute('aria-label') || one.labels?.length || one.textContent.trim()
    || one.getAttribute('aria-labelledby')))
  .map((one) => one.outerHTML)"""
TWICE = """() => [...document.querySelectorAll('[id]')].map((one) => one.id)
  .filter((id, i, all) => all.indexOf(id) !== i)"""
CONTRAST = """() => {
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => {
    const linear = (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
    const [x, y, z] = [r, g, b].map((c) => linear(c / 255));
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const behind = (one) => {
    for (; one; one = one.parentElement) {
      const colour = parse(getComputedStyle(one).backgroundColor);
      if (colour.length === 3 || colour[3] > 0.99) return colour;
    }
    return [255, 255, 255];
  };
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const faint = [];
  while (texts.nextNode()) {
    const one = texts.currentNode.parentElement;
    if (!texts.currentNode.data.trim() || !one.checkVisibility({ opacityProperty: true })) continue;
    if (/^(SCRIPT|STYLE|OPTION)$/.test(one.tagName)) continue;
    const [a, b] = [light(parse(getComputedStyle(one).color)), light(behind(one))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < 4.5) faint.push([texts.currentNode.data, contrast]);
  }
  return faint;
}"""


@pytest.mark.parametrize(("theme", "width"), [("light", 400), ("dark", 2560)])
def test_everything_has_a_name_contrast_and_room(opened, written, theme, width):
    page = opened.page
    page.emulate_media(color_scheme=theme)
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(written.as_uri())
    for tab in ("events", "tracks", "measure", "places", "camera"):
        page.locator(f"#tab-{tab}").click()
        assert page.evaluate(NAMES) == []
        assert page.evaluate(CONTRAST) == [], tab
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(TWICE) == []


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
