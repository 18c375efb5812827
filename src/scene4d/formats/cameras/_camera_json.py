"""``camera.json``, scene4d's own format; every field of it stands in the reference."""

import json
from pathlib import Path

from scene4d.core.camera import SCHEMA, Camera
from scene4d.formats.cameras._contract import CameraFormat, ImageSize


def _sniff(path: Path, head: str) -> bool:
    return head.lstrip().startswith("{") and ('"scene4d/' in head or path.suffix == ".json")


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    return Camera.load(path)


def _write(camera: Camera) -> str:
    return json.dumps(camera.to_dict(), indent=1, allow_nan=False) + "\n"


FORMAT = CameraFormat(
    "json", f"scene4d's own format ({SCHEMA})", _sniff, _read, _write, fisheye=True
)
