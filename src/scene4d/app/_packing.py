"""Columns of numbers as text for a page: 16 bits each, with the error that this makes."""

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

_LEVELS = 65_534
"""The largest code of a number; one more is for what is unknown."""
_UNKNOWN = 65_535


def packed(columns: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Columns (n,) of floats, each as ``offset + scale * code`` with codes of 16 bits in base64.

    ``error`` is the largest difference that this makes: half a step. Code 65535 is NaN.
    """
    return {name: _quantised(np.asarray(values, float)) for name, values in columns.items()}


def _quantised(values: np.ndarray) -> dict[str, Any]:
    known = np.isfinite(values)
    low = float(values[known].min()) if known.any() else 0.0
    high = float(values[known].max()) if known.any() else 0.0
    scale = (high - low) / _LEVELS or 1.0
    codes = np.full(len(values), _UNKNOWN, "<u2")
    codes[known] = np.rint((values[known] - low) / scale)
    error = scale / 2 if high > low else 0.0
    return {"offset": low, "scale": scale, "error": error, "codes": _text(codes)}


def milliseconds(time_s: np.ndarray) -> str:
    """Times (n,) in seconds as whole milliseconds of 32 bits in base64: up to 24 days."""
    return _text(np.rint(time_s * 1000).astype("<i4"))


def integers(values: np.ndarray) -> str:
    """Whole numbers (n,) of 32 bits in base64."""
    return _text(values.astype("<i4"))


def flags(values: np.ndarray) -> str:
    """True and false (n,) as bytes in base64."""
    return _text(values.astype(np.uint8))


def _text(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
