"""Detectors by name: the built-in ones and those that other packages register.

A package registers a detector as an entry point of the group ``scene4d.detectors``; the entry is
called without arguments, or with ``device`` where one was asked for and it takes one, and returns
a :class:`~scene4d.perception.detectors._base.Detector`.
"""

from importlib.metadata import EntryPoint, entry_points
from inspect import signature
from typing import TYPE_CHECKING

from scene4d.core.errors import InputError, UnavailableError

if TYPE_CHECKING:
    from scene4d.perception.detectors._base import Detector

GROUP = "scene4d.detectors"
_HERE = "scene4d.perception.detectors"
_BUILT_IN = (
    EntryPoint("torchvision-maskrcnn", f"{_HERE}._maskrcnn:MaskRcnnDetector", GROUP),
    EntryPoint("yolov4-tiny", f"{_HERE}._yolov4:Yolov4TinyDetector", GROUP),
    EntryPoint("yolox", f"{_HERE}.yolox:YoloxDetector", GROUP),
)


def _registered() -> dict[str, EntryPoint]:
    # The built-in names come last: another package cannot take them over silently.
    return {entry.name: entry for entry in (*entry_points(group=GROUP), *_BUILT_IN)}


def detector_names() -> tuple[str, ...]:
    """Names that :func:`make_detector` knows, in order of the alphabet."""
    return tuple(sorted(_registered()))


def make_detector(name: str = "yolox", device: str = "auto") -> "Detector":
    """The detector registered under ``name``, with its defaults.

    Raises :class:`InputError` for a name nobody registered, for a device that is not here or of
    which the detector leaves no choice, and :class:`UnavailableError` where
    the library that the detector needs is not installed.
    """
    entry = _registered().get(name)
    if entry is None:
        raise InputError(
            f"detector: found {name!r}, expected one of {', '.join(detector_names())}; "
            f"a package adds one by the entry-point group {GROUP!r}"
        )
    try:
        factory = entry.load()
    except ImportError as error:
        raise UnavailableError(
            f"detector {name!r} ({entry.value}) cannot be loaded: {error}; install what it needs"
        ) from error
    if device == "auto":
        detector: Detector = factory()
        return detector
    if "device" not in signature(factory).parameters:
        raise InputError(f"device: detector {name!r} chooses its own, expected 'auto'")
    placed: Detector = factory(device=device)
    return placed
