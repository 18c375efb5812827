"""Self-contained HTML pages: templates of any room over one base, pictures inside the page."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

EMBED_BYTES = 520_000
"""Most that one figure takes inside the page; the PNG files keep everything."""


@dataclass(frozen=True)
class Shown:
    """A figure as the page shows it."""

    name: str
    uri: str
    alt: str
    caption: str


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
    """A ``data:`` URI of the picture: the PNG where it is small, else a JPEG of full colour.

    The quality falls until the picture fits :data:`EMBED_BYTES`, but not below 60.
    """
    if len(png) <= EMBED_BYTES / 2:
        return "data:image/png;base64," + base64.b64encode(png).decode()
    import cv2

    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    full_colour = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    jpeg = b""
    for quality in (90, 82, 72, 60):
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, *full_colour]
        jpeg = cv2.imencode(".jpg", pixels, options)[1].tobytes()
        if len(jpeg) <= EMBED_BYTES:
            break
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
