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

from scene4d.core.errors import UnavailableError
from scene4d.perception.detectors._base import require_bgr

_THREADS = 2
"""Chosen by hand: the decoder needs cores too."""
_THRESHOLD = 0.5
_MASK_LEVEL = 0.5
"""Score from which a box is believed, and a pixel belongs to it: the customary halves."""


class MaskRcnnDetector:
    """Finds the 80 classes of COCO, with a mask each, in ``sv.Detections.mask`` (n, h, w).

    Seconds a frame, on the processor. The weights are torchvision's own file, which torch keeps in
    its cache and fetches where it can. Raises :class:`UnavailableError` where torch, torchvision
    or the weights are missing.
    """

    def __init__(self) -> None:
        self._torch, torchvision = _libraries()
        detection = torchvision.models.detection
        published = detection.MaskRCNN_ResNet50_FPN_Weights.COCO_V1
        self.class_names = tuple(published.meta["categories"])
        self._model = detection.maskrcnn_resnet50_fpn(weights=None, weights_backbone=None)
        self._model.load_state_dict(_state(self._torch, published))
        self._model.eval()

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Objects of one image, best first, with ``data["class_name"]`` and masks."""
        require_bgr(image_bgr)
        torch = self._torch
        rgb = np.ascontiguousarray(image_bgr[:, :, ::-1].transpose(2, 0, 1))
        picture = torch.from_numpy(rgb).float() / 255
        before = torch.get_num_threads()
        torch.set_num_threads(min(_THREADS, before))
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
        rows = (score >= _THRESHOLD) & (box[:, 2:] > box[:, :2]).all(axis=1)
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


def _state(torch: Any, published: Any) -> Any:
    """The weights' tensors by name, from torch's own cache."""
    try:
        return published.get_state_dict(progress=False, check_hash=True)
    except Exception as error:  # whatever the network, the disk or a damaged file brings
        name = published.url.rsplit("/", 1)[-1]
        place = Path(torch.hub.get_dir()) / "checkpoints" / name
        raise UnavailableError(
            f"weights of 'torchvision-maskrcnn': {name} is not at {place} in whole and could "
            f"not be fetched ({error}); copy the file to {place}"
        ) from error
