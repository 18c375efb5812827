"""Fields of YAML, XML and JSON camera files: matrices in their several spellings."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.text import floats, quoted
from scene4d.core.yaml_text import load_yaml
from scene4d.formats._numbers import flat


def yaml_fields(text: str) -> dict[str, Any]:
    """The fields of a YAML mapping; OpenCV's ``%YAML:1.0`` first line, which is not YAML, is let
    pass. Raises :class:`InputError` naming the line.
    """
    if text.startswith("%YAML"):
        text = "#" + text  # a comment keeps the line numbers
    values = load_yaml(text)
    if not isinstance(values, dict):
        raise InputError("expected a YAML mapping of named fields at the top")
    return values


def find(values: Mapping[str, Any], *names: str) -> tuple[str, Any] | None:
    """The first field present under one of these names, which are compared case by case."""
    return next(((name, values[name]) for name in names if values.get(name) is not None), None)


def require(values: Mapping[str, Any], *names: str) -> tuple[str, Any]:
    """As :func:`find`; raises :class:`InputError` naming the field that is missing."""
    found = find(values, *names)
    if found is None:
        raise InputError(f"field {names[0]!r} is missing")
    return found


def numbers(name: str, value: Any) -> Float[np.ndarray, "n"]:
    """All numbers of a field, row by row: nested lists, or a mapping with ``data``."""
    if isinstance(value, Mapping):
        rows, cols, data = (value.get(key) for key in ("rows", "cols", "data"))
        found = numbers(name, None if isinstance(data, Mapping) else data)
        if isinstance(rows, int) and isinstance(cols, int) and rows * cols != len(found):
            raise InputError(
                f"field {name!r}: expected {quoted(rows)}x{quoted(cols)} numbers, "
                f"found {len(found)}"
            )
        return found
    if not isinstance(value, list):
        raise InputError(f"field {name!r}: expected a list of numbers, found {quoted(value)}")
    return floats(flat(value), f"field {name!r}")


def matrix(name: str, value: Any, rows: int, cols: int) -> np.ndarray:
    """A field as a matrix of this shape. Raises :class:`InputError` for another count."""
    data = numbers(name, value)
    if len(data) != rows * cols:
        raise InputError(f"field {name!r}: expected {rows}x{cols} numbers, found {len(data)}")
    return data.reshape(rows, cols)


def intrinsic_matrix(name: str, value: Any) -> np.ndarray:
    """A 3x3 K, whose last row must be (0, 0, 1)."""
    K = matrix(name, value, 3, 3)
    if not np.allclose(K[2], [0, 0, 1]) or K[1, 0] != 0:
        raise InputError(f"field {name!r}: is no camera matrix, its last row must be 0 0 1")
    return K


def image_size(values: Mapping[str, Any]) -> tuple[int, int] | None:
    """``image_width`` and ``image_height`` or ``image_size``; None where the file has neither."""
    width = find(values, "image_width", "image_Width", "width", "width_px")
    height = find(values, "image_height", "image_Height", "height", "height_px")
    if width and height:
        return _positive_int(*width), _positive_int(*height)
    both = find(values, "image_size", "imageSize")
    if both is None:
        return None
    size = matrix(*both, 1, 2)[0]
    return _positive_int(both[0], float(size[0])), _positive_int(both[0], float(size[1]))


def _positive_int(name: str, value: Any) -> int:
    number = float(floats([value], f"field {name!r}")[0])
    if number != int(number) or number < 1:
        raise InputError(f"field {name!r}: expected a positive whole number, found {quoted(value)}")
    return int(number)
