"""How often each tilt is trained, which is taken out of what the network says."""

import json
from collections.abc import Sequence

import numpy as np
import onnx
from jaxtyping import Float

from scene4d.perception.orientation.grid import TILT_RAD, VFOV_RAD
from training.panoramas import Panorama
from training.samples import STREET_SHARE, sample_view
from training.streets import SIZE

ENTRY = "log_tilt_given_vfov"
"""Of the ONNX file's metadata."""
_DRAWS = 60_000
_BLUR_CELLS = 0.7  # of the targets in training.loss
_FLOOR = 0.04
"""Share that is spread evenly: cells that were hardly ever trained keep a finite probability."""


def trained_tilts(photographs: Sequence[Panorama]) -> Float[np.ndarray, "37 21"]:
    """Log-probability of tilt given the field of view in :func:`.sample_view`, by simulation."""
    rng = np.random.default_rng(0)
    scene = Panorama("street", (np.empty((SIZE[1], SIZE[0], 3), np.uint8),))
    tilt, vfov = np.empty((2, _DRAWS))
    for n in range(_DRAWS):
        from_mast = rng.random() < STREET_SHARE
        shown = scene if from_mast else photographs[rng.integers(len(photographs))]
        view = sample_view(rng, shown, from_mast)
        tilt[n], vfov[n] = view.tilt_rad, view.vfov_rad
    return conditional(tilt, vfov)


def conditional(
    tilt_rad: Float[np.ndarray, "n"], vfov_rad: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "37 21"]:
    """Log-probability of tilt given the field of view among these cameras, as targets blur them."""
    joint = _soft(tilt_rad, TILT_RAD).T @ _soft(np.log(vfov_rad), np.log(VFOV_RAD))
    joint = (1 - _FLOOR) * joint / joint.sum() + _FLOOR / joint.size
    return np.log(joint / joint.sum(axis=0))


def attach(model: onnx.ModelProto, log_tilt_given_vfov: Float[np.ndarray, "37 21"]) -> None:
    """Write it into the metadata of a network."""
    kept = {entry.key: entry.value for entry in model.metadata_props if entry.key != ENTRY}
    rows = [[round(float(value), 3) for value in row] for row in log_tilt_given_vfov]
    onnx.helper.set_model_props(model, kept | {ENTRY: json.dumps(rows)})


def _soft(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    place = (values[:, None] - nodes[0]) / (nodes[1] - nodes[0])
    weight = np.exp(-0.5 * ((np.arange(len(nodes)) - place) / _BLUR_CELLS) ** 2)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))
