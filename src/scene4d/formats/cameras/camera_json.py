"""``camera.json``, scene4d's own format; every field of it stands in the reference."""

import json
from pathlib import Path

from scene4d.core.camera import SCHEMA, Camera
from scene4d.core.errors import InputError
from scene4d.formats.cameras.contract import CameraFormat, ImageSize


def _sniff(path: Path, head: str) -> bool:
    return head.lstrip().startswith("{") and ("scene4d/" in head or path.suffix == ".json")


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    try:
        return Camera.load(path)
    except OverflowError as error:  # an infinite image size
        raise InputError(f"field 'image_size': {error}") from error


def _write(camera: Camera) -> str:
    return json.dumps(camera.to_dict(), indent=1, allow_nan=False) + "\n"


FORMAT = CameraFormat(
    name="json",
    description=f"scene4d's own format ({SCHEMA})",
    patterns=("*.json",),
    sniff=_sniff,
    read=_read,
    write=_write,
)
