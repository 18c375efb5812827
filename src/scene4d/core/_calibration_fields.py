"""Fields of a ``camera.json`` that say how good the camera is."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from scene4d.core.json_object import JsonObject

_ALWAYS = ("focal_px", "tilt_deg", "roll_deg", "height_m")
_AGREES = 0.01
"""Share by which what is stated twice may differ: a file may have been rounded."""


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


def stated_sigma(
    fields: JsonObject,
    units: Mapping[str, tuple[int, float]],
    covariance: Float[np.ndarray, "p p"] | None,
    count: int,
) -> Float[np.ndarray, "_ _"] | None:
    """The covariance of all ``count`` parameters that ``sigma`` gives where the file has no
    ``covariance``: of independent ones. Of a file that has both they must agree.

    ``units`` holds for each name the number of its parameter and the size of that one's unit.
    """
    names = fields.object("sigma").names() if "sigma" in fields else []
    if not names:
        return covariance
    inside = fields.object("sigma")
    inside.only(units)
    variance = np.zeros(count)
    for name in {*_ALWAYS, *names}:
        number, unit = units[name]
        variance[number] = (inside.number(name, least=0.0) / unit) ** 2
        if covariance is not None and number < len(covariance):
            wanted = unit * np.sqrt(covariance[number, number])
            if abs(inside.number(name) - wanted) > _AGREES * wanted:
                expected = f"{wanted:.4g}, as the covariance says; give one of the two alone"
                raise inside.error(name, expected)
    return np.diag(variance) if covariance is None else covariance


def over_all_parameters(values: np.ndarray, first: int, count: int) -> np.ndarray:
    """A covariance, or derivatives in columns, of the first five parameters as those of all."""
    values = np.asarray(values, float)
    missing = count - values.shape[1]
    if missing != count - first:
        return values
    rows = missing if values.shape[0] == values.shape[1] else 0
    return np.pad(values, ((0, rows), (0, missing)))
