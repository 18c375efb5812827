"""Mask R-CNN of torchvision, the detector of Wagner et al. (2019); its masks are kept.

Source: He et al., "Mask R-CNN" (ICCV 2017), with ResNet-50 and a feature pyramid, trained on COCO.
torch and torchvision are imported when a detector is made, never before.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import supervision as sv
from jaxtyping import UInt8

from scene4d.core.errors import InputError, UnavailableError
from scene4d.perception.detectors.base import require_bgr
from scene4d.perception.session import DEFAULT_THREADS

_THRESHOLD = 0.5
_MASK_LEVEL = 0.5

_WEIGHTS = "MaskRCNN_ResNet50_FPN_Weights"


class MaskRcnnDetector:
    """Finds the 80 classes of COCO, with a mask each, in ``sv.Detections.mask`` (n, h, w).

    Seconds a frame on a processor; ``device`` "cuda" where torch has one. ``weights`` None is
    torchvision's own file, which torch keeps in its cache and fetches where it can. Raises
    :class:`UnavailableError` where torch, torchvision or the weights are missing, and
    :class:`InputError` where ``weights`` is not a file of this network.
    """

    def __init__(
        self,
        weights: Path | None = None,
        *,
        threads: int = DEFAULT_THREADS,
        threshold: float = _THRESHOLD,
        device: str = "cpu",
    ) -> None:
        self.threshold = threshold
        self._threads = threads
        self._device = device
        self._torch, self._torchvision = _libraries()
        detection = self._torchvision.models.detection
        published = getattr(detection, _WEIGHTS).COCO_V1
        self.class_names = tuple(published.meta["categories"])
        state = _state(self._torch, published, weights)
        model = detection.maskrcnn_resnet50_fpn(weights=None, weights_backbone=None)
        try:
            model.load_state_dict(state)
        except (RuntimeError, TypeError, AttributeError) as error:
            raise InputError(
                f"{weights}: not the weights of torchvision's maskrcnn_resnet50_fpn: {error}"
            ) from error
        self._model = _on_device(model.eval(), device)

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Objects of one image, best first, with ``data["class_name"]`` and masks."""
        require_bgr(image_bgr)
        torch = self._torch
        rgb = np.ascontiguousarray(image_bgr[:, :, ::-1].transpose(2, 0, 1))
        picture = torch.from_numpy(rgb).to(self._device).float() / 255
        before = torch.get_num_threads()
        torch.set_num_threads(min(self._threads, before))
        try:
            with torch.inference_mode():
                out = self._model([picture])[0]
        finally:
            torch.set_num_threads(before)
        box, score, label, mask = (
            out[name].detach().cpu().numpy() for name in ("boxes", "scores", "labels", "masks")
        )
        height, width = image_bgr.shape[:2]
        # torchvision measures from the image's edge, not from the first pixel's centre.
        box = box.reshape(-1, 4).astype(float) - 0.5
        box[:, 0::2] = box[:, 0::2].clip(-0.5, width - 0.5)
        box[:, 1::2] = box[:, 1::2].clip(-0.5, height - 0.5)
        rows = (score >= self.threshold) & (box[:, 2:] > box[:, :2]).all(axis=1)
        rows = np.flatnonzero(rows)
        rows = rows[np.argsort(-score[rows], kind="stable")]
        return sv.Detections(
            xyxy=box[rows],
            confidence=score[rows].astype(float),
            class_id=label[rows].astype(np.int64),
            mask=mask.reshape(-1, height, width)[rows] >= _MASK_LEVEL,
            data={"class_name": np.array(self.class_names)[label[rows].astype(np.int64)]},
        )


def _libraries() -> tuple[Any, Any]:
    try:
        torch = import_module("torch")
        torchvision = import_module("torchvision")
        import_module("torchvision.models.detection")
    except ImportError as error:
        raise UnavailableError(
            f"detector 'torchvision-maskrcnn' needs torch and torchvision ({error}); install them "
            "with `pip install scene4d[torch]`"
        ) from error
    except (RuntimeError, OSError, AttributeError) as error:
        # A torchvision built for CUDA beside a torch for the processor alone fails as it is
        # imported: "operator torchvision::nms does not exist".
        raise UnavailableError(
            f"detector 'torchvision-maskrcnn': torch and torchvision are installed but do not fit "
            f"together ({str(error).strip()}); both must be CUDA builds or both builds for the "
            "processor alone, of matching versions: remove both with `pip uninstall torch "
            "torchvision` and install them together from one place with "
            "`pip install scene4d[torch]`"
        ) from error
    return torch, torchvision


def _state(torch: Any, published: Any, weights: Path | None) -> Any:
    """The weights' tensors by name, from the file given or from torch's own cache."""
    if weights is None:
        name = published.url.rsplit("/", 1)[-1]
        place = Path(torch.hub.get_dir()) / "checkpoints" / name
        try:
            return published.get_state_dict(progress=False, check_hash=True)
        except Exception as error:  # whatever the network, the disk or a damaged file brings
            raise UnavailableError(
                f"weights of 'torchvision-maskrcnn': {name} is not at {place} in whole and could "
                f"not be fetched ({error}); copy the file to {place}, or give its path as weights"
            ) from error
    if not weights.is_file():
        raise InputError(f"{weights}: there is no such file, expected Mask R-CNN weights (.pth)")
    try:
        return torch.load(str(weights), map_location="cpu", weights_only=True)
    except Exception as error:  # pickle, zip and torch each bring errors of their own
        raise InputError(f"{weights}: not a file of torch tensors: {error}") from error


def _on_device(model: Any, device: str) -> Any:
    try:
        return model.to(device)
    except (RuntimeError, AssertionError) as error:
        raise UnavailableError(f"device {device!r} cannot be used by torch: {error}") from error
