"""What is known of a camera's orientation beforehand, as a Gaussian."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.files import read_json

_FIELDS = ("focal_px", "tilt_deg", "roll_deg")


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"orientation: {name} must be a number, found {value!r}") from None


@dataclass(frozen=True)
class Orientation:
    """Focal length (pixels), tilt and roll (radians), each with a standard deviation.

    A standard deviation of 0 means exactly known, infinity means unknown.
    ``focal_tilt_correlation`` is that of the errors of log focal length and tilt: a picture often
    tells the horizon's row, ``focal · tan(tilt)``, better than either.
    """

    focal_px: float
    tilt_rad: float
    roll_rad: float
    focal_sigma_px: float = 0.0
    tilt_sigma_rad: float = 0.0
    roll_sigma_rad: float = 0.0
    focal_tilt_correlation: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.focal_px) and self.focal_px > 0):
            raise InputError(f"orientation: focal_px must be positive, found {self.focal_px}")
        if not abs(self.tilt_rad) <= np.pi / 2:
            raise InputError(
                f"orientation: tilt_rad must lie within ±π/2 (straight up or down), "
                f"found {self.tilt_rad}"
            )
        for name in ("tilt_rad", "roll_rad"):
            if not abs(getattr(self, name)) <= np.pi:
                raise InputError(
                    f"orientation: {name} must lie within ±π (180°), found {getattr(self, name)}"
                )
        for name in ("focal_sigma_px", "tilt_sigma_rad", "roll_sigma_rad"):
            if not getattr(self, name) >= 0:
                raise InputError(
                    f"orientation: {name} must be 0 or more, found {getattr(self, name)}"
                )

        if not abs(self.focal_tilt_correlation) < 1:
            raise InputError(
                "orientation: focal_tilt_correlation must lie within ±1, found "
                f"{self.focal_tilt_correlation}"
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Orientation":
        """Read ``{"focal_px", "tilt_deg", "roll_deg", "sigma": {...}}``; sigma is optional.

        Raises :class:`InputError` naming the file and the field; unknown fields are let pass
        only where ``scene4d orientation --json`` writes them.
        """
        values = read_json(path)
        if not isinstance(values, dict):
            raise InputError(f"{path}: expected an object with {', '.join(_FIELDS)}")
        sigma = {} if values.get("sigma") is None else values["sigma"]
        unknown = set(values) - {*_FIELDS, "sigma", "vfov_deg", "frames"}
        if not isinstance(sigma, dict):
            raise InputError(f"{path}: field 'sigma' must be an object")
        unknown |= set(sigma) - {*_FIELDS, "vfov_deg"}
        if unknown:
            raise InputError(f"{path}: unknown field {sorted(unknown)[0]!r}; known: {_FIELDS}")
        try:
            numbers = [_number(name, values[name]) for name in _FIELDS]
            spread = [_number(f"sigma {name}", sigma.get(name, 0.0)) for name in _FIELDS]
            scale = np.array([1.0, np.pi / 180, np.pi / 180])
            return cls(*(numbers * scale), *(spread * scale))
        except KeyError as error:
            raise InputError(f"{path}: field {error} is missing") from error
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
