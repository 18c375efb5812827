"""Turn a fixed camera into a metric sensor, from the people who walk through its own footage.

``calibrate`` finds the camera of footage, ``solve_camera`` that of points; ``track`` writes a
:class:`Scene` of people and vehicles in metres, ``watch`` does so while a camera runs; ``search``
finds activities in it that are told in words. ``align`` puts several scenes on one ground and one
clock, a :class:`Site`. :class:`Camera` projects and locates. Everything is loaded when it is first
used, so that importing the package costs nothing.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scene4d.alignment import align as align
    from scene4d.calibration import solve_camera as solve_camera
    from scene4d.calibration.calibrating import calibrate as calibrate
    from scene4d.core.calibration import Calibration as Calibration
    from scene4d.core.camera import Camera as Camera
    from scene4d.core.camera import Lens as Lens
    from scene4d.core.orientation import Orientation as Orientation
    from scene4d.formats.cameras import read_camera as read_camera
    from scene4d.formats.cameras import write_camera as write_camera
    from scene4d.searching import search as search
    from scene4d.store.query import Scene as Scene
    from scene4d.store.site import Site as Site
    from scene4d.tracking import track as track
    from scene4d.tracking import watch as watch

    __version__: str

_WHERE = {
    "Calibration": "scene4d.core.calibration",
    "Camera": "scene4d.core.camera",
    "Lens": "scene4d.core.camera",
    "Orientation": "scene4d.core.orientation",
    "Scene": "scene4d.store.query",
    "Site": "scene4d.store.site",
    "align": "scene4d.alignment",
    "calibrate": "scene4d.calibration.calibrating",
    "read_camera": "scene4d.formats.cameras",
    "search": "scene4d.searching",
    "solve_camera": "scene4d.calibration",
    "track": "scene4d.tracking",
    "watch": "scene4d.tracking",
    "write_camera": "scene4d.formats.cameras",
}

__all__ = sorted([*_WHERE, "__version__"])


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("scene4d")
    if name not in _WHERE:
        raise AttributeError(f"module 'scene4d' has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(_WHERE[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
