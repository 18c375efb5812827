"""What tests do in a page: pixels of the footage, and where they are on the screen."""

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from walks import SIZE


def picture_at(page: Page, u: float, v: float, size: tuple[int, int] = SIZE) -> tuple[float, float]:
    """Where a pixel of the footage is on the screen while the whole picture is shown."""
    box = page.locator("#picture").bounding_box()
    assert box is not None
    width, height = size
    scale = min(box["width"] / width, box["height"] / height)
    x = box["x"] + (box["width"] - scale * width) / 2 + scale * (u + 0.5)
    return x, box["y"] + (box["height"] - scale * height) / 2 + scale * (v + 0.5)


def click(page: Page, u: float, v: float) -> tuple[float, float]:
    """Click at whole pixels of the screen; returns the pixel of the footage that this is."""
    x, y = map(round, picture_at(page, u, v))
    page.mouse.click(x, y)
    x0, y0 = picture_at(page, 0, 0)
    x1, _ = picture_at(page, 1, 0)
    return (x - x0) / (x1 - x0), (y - y0) / (x1 - x0)


def violations(page: Page) -> list[tuple[str, str]]:
    """What axe finds wrong for those who do not see or point: rule, and the first element."""
    found = Axe().run(page).response["violations"]
    return [(one["id"], one["nodes"][0]["html"]) for one in found]
