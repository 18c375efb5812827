"""Prior knowledge of a camera's orientation, as a Gaussian."""

import os
from dataclasses import dataclass

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import in_file

_FIELDS = ("focal_px", "tilt_deg", "roll_deg")
_WRITTEN = ("schema", "version", "warnings", "error", "vfov_deg", "frames")
"""Other fields that ``scene4d orientation --json`` writes."""


@dataclass(frozen=True)
class Orientation:
    """Focal length (pixels), tilt and roll (radians), each with a standard deviation.

    A standard deviation of 0 means exactly known, infinity means unknown.
    ``focal_tilt_correlation`` is the correlation of the errors of log focal length and tilt: an
    image often determines the horizon's row, ``focal · tan(tilt)``, better than either of the two.
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

    @property
    def spread(self) -> tuple[float, float, float]:
        """Standard deviations of log focal length, tilt and roll (radians)."""
        return self.focal_sigma_px / self.focal_px, self.tilt_sigma_rad, self.roll_sigma_rad

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Orientation":
        """Read ``{"focal_px", "tilt_deg", "roll_deg", "sigma": {...}}``; sigma is optional.

        Raises :class:`InputError` naming the file and the field, also one that is not known here
        and that ``scene4d orientation --json`` does not write.
        """
        fields = JsonObject.read(path)
        fields.only((*_FIELDS, "sigma", *_WRITTEN))
        numbers = [fields.number(name) for name in _FIELDS]
        spread = [0.0, 0.0, 0.0]
        if "sigma" in fields:
            sigma = fields.object("sigma")
            sigma.only((*_FIELDS, "vfov_deg"))
            spread = [_sigma(sigma, name) for name in _FIELDS]
        scale = np.array([1.0, np.pi / 180, np.pi / 180])
        with in_file(path):
            return cls(*(numbers * scale), *(spread * scale))


def _sigma(fields: JsonObject, name: str) -> float:
    """0 where it is missing; infinity means unknown."""
    if name not in fields:
        return 0.0
    return np.inf if fields.value(name) == np.inf else fields.number(name, least=0.0)
