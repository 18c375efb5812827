"""Recordings with a true camera, and where people walked in them (layout: see the README)."""

from pathlib import Path

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.evaluation.reference import Reference
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera


def _reference(name: str, camera_file: Path, annotations: Path) -> Reference:
    camera = read_camera(camera_file)
    if not isinstance(camera, Camera):
        raise InputError(f"{camera_file}: holds a lens without a pose, and cannot be a reference")
    boxes = read_annotations(annotations, image_size=camera.image_size)
    return Reference(name, camera, boxes.box_foot_uv)


def pets(data: str | Path) -> Reference:
    """PETS 2009 S2.L1 View_001: Tsai camera and hand-drawn boxes; ``data`` holds their files."""
    folder = Path(data)
    return _reference("PETS 2009", folder / "View_001.xml", folder / "PETS2009-S2L1.xml")


def towncentre(data: str | Path) -> Reference:
    """TownCentre: camera and annotated feet. The boxes' heights are circular and not used."""
    folder = Path(data)
    return _reference(
        "TownCentre", folder / "TownCentre-calibration.ci", folder / "TownCentreGTHalfRes.csv"
    )
