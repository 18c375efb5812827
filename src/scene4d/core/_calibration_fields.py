"""Fields of a ``camera.json`` that say how good the camera is."""

import numpy as np
from jaxtyping import Float

from scene4d.core.json_object import JsonObject


def errors_in(fields: JsonObject, name: str) -> dict[str, float] | None:
    if name not in fields:
        return None
    inside = fields.object(name)
    return {key: inside.number(key, least=0.0) for key in inside.names()}


def texts(fields: JsonObject) -> dict[str, str]:
    return {name: fields.text(name) for name in fields.names()}


def uncertainty(
    fields: JsonObject, known: tuple[tuple[str, ...], ...]
) -> tuple[Float[np.ndarray, "p p"] | None, Float[np.ndarray, "3 p"] | None]:
    """``covariance`` and ``scene_motion``, over one of the ``known`` lists of parameters; None if
    missing from the file.
    """
    if "covariance" not in fields:
        return None, None
    inside = fields.object("covariance")
    names = inside.texts("parameters")
    n = len(names)
    if names not in known:
        raise inside.error("parameters", f"the list {', '.join(known[0])}")
    matrix = inside.array("matrix", n, n)
    size = float(np.abs(matrix).max())
    symmetric = np.allclose(matrix, matrix.T, rtol=0, atol=1e-9 * size)
    if not symmetric or np.linalg.eigvalsh(matrix).min() < -1e-9 * size:
        raise inside.error("matrix", "a covariance: symmetric, with no negative variance")
    motion = inside.array("scene_motion", 3, n) if "scene_motion" in inside else None
    return matrix, motion


def over_all_parameters(values: np.ndarray, first: int, count: int) -> np.ndarray:
    """A covariance, or derivatives in columns, of the first five parameters as those of all."""
    values = np.asarray(values, float)
    missing = count - values.shape[1]
    if missing != count - first:
        return values
    rows = missing if values.shape[0] == values.shape[1] else 0
    return np.pad(values, ((0, rows), (0, missing)))
