"""Self-contained HTML pages: templates of any room over one base, pictures inside the page."""

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from scene4d.drawing.style import Drawn

EMBED_BYTES = 520_000
"""Most that one figure takes inside the page; the PNG files keep everything."""


@dataclass(frozen=True)
class Shown:
    """A figure as the page shows it."""

    name: str
    uri: str
    alt: str
    caption: str
    legend: tuple[tuple[str, str], ...] = ()
    """Labels, each with its mark as SVG, where the picture has no legend of its own."""


def as_shown(
    pictures: "Mapping[str, Drawn]", alt: Callable[[str], str], caption: Callable[[str], str]
) -> dict[str, Shown]:
    """Figures by name, each with its alternative text and its caption."""
    return {
        name: Shown(name, data_uri(drawn.page_png), alt(name), caption(name), drawn.legend)
        for name, drawn in pictures.items()
    }


def made_by(command: str | None) -> list[tuple[str, str]]:
    """The last lines of a page's provenance: the version, and the command if there was one."""
    return [("scene4d", version("scene4d")), *([("Command", command)] if command else [])]


def rendered(package: str, template: str, values: Mapping[str, Any]) -> str:
    """A page from a template of ``package``, which may extend those of this room.

    A value that the template wants and nobody gave is an error.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("scene4d.drawing")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(values)


def seconds_text(seconds: float) -> str:
    """Seconds to a tenth; what is shorter is not shown as nothing."""
    return f"{seconds:.1f}" if seconds >= 0.05 else "below 0.1"


def data_uri(png: bytes) -> str:
    """A ``data:`` URI of the picture: the PNG where it is small, else a WebP.

    The quality falls until the picture fits :data:`EMBED_BYTES`, but not below 60.
    """
    if len(png) <= EMBED_BYTES / 2:
        return "data:image/png;base64," + base64.b64encode(png).decode()
    import cv2

    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    webp = b""
    for quality in (92, 84, 72, 60):
        webp = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()
        if len(webp) <= EMBED_BYTES:
            break
    return "data:image/webp;base64," + base64.b64encode(webp).decode()
