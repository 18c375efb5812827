"""Regions of the picture whose ground lies above or below that of the camera."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import quoted


@dataclass(frozen=True, eq=False)
class GroundRegion:
    """A second ground, parallel to Z = 0, under the feet that are seen inside ``polygon_uv``.

    ``polygon_uv`` (k, 2) are the corners in pixels of the footage, ``height_m`` is the height of
    its ground (negative below Z = 0) and ``sigma_m`` the standard deviation of that. Raises
    :class:`InputError` for fewer than three corners and for values that are not finite.
    """

    polygon_uv: Float[np.ndarray, "k 2"]
    height_m: float
    sigma_m: float

    def __post_init__(self) -> None:
        corners = np.array(self.polygon_uv, float)
        if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3:
            raise InputError(
                "polygon_uv must be three or more corners (u, v), found "
                f"{quoted(np.asarray(self.polygon_uv).tolist())}"
            )
        for name, values in (("polygon_uv", corners), ("height_m", self.height_m)):
            if not np.isfinite(values).all():
                raise InputError(f"{name} must be finite, found {quoted(values)}")
        if not 0 <= self.sigma_m < np.inf:
            raise InputError(f"sigma_m must be 0 or more, found {quoted(self.sigma_m)}")
        corners.setflags(write=False)
        object.__setattr__(self, "polygon_uv", corners)

    def contains(self, uv: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which pixels lie inside: those from which a ray crosses the outline an odd number of
        times. NaN lies outside.
        """
        u, v = uv[:, 0, None], uv[:, 1, None]
        u0, v0 = self.polygon_uv.T
        u1, v1 = np.roll(self.polygon_uv, -1, axis=0).T
        spans = (v0 > v) != (v1 > v)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = u0 + (v - v0) / (v1 - v0) * (u1 - u0)
            beyond = spans & (u < crossing)
        odd: np.ndarray = beyond.sum(axis=1) % 2 == 1
        return odd

    def to_dict(self) -> dict[str, Any]:
        """Its fields in ``camera.json``."""
        return {
            "polygon_uv": np.round(self.polygon_uv, 2).tolist(),
            "height_m": self.height_m,
            "sigma_m": self.sigma_m,
        }

    @classmethod
    def all_in(cls, fields: JsonObject, camera_height_m: float) -> "tuple[GroundRegion, ...]":
        """The ``ground_regions`` of a ``camera.json``, none where it names none; raises
        :class:`InputError` naming the field.
        """
        if "ground_regions" not in fields:
            return ()
        return tuple(cls._of(r, camera_height_m) for r in fields.objects("ground_regions"))

    @classmethod
    def _of(cls, fields: JsonObject, camera_height_m: float) -> "GroundRegion":
        fields.only(("polygon_uv", "height_m", "sigma_m"))
        corners = fields.array("polygon_uv", None, 2)
        if len(corners) < 3:
            raise fields.error("polygon_uv", "three or more corners [u, v]")
        height_m = fields.number("height_m")
        if height_m >= camera_height_m:
            raise fields.error("height_m", f"below the camera, which hangs at {camera_height_m} m")
        return cls(corners, height_m, fields.number("sigma_m", least=0.0))


def ground_heights(
    regions: tuple[GroundRegion, ...], uv: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Height (m) of the ground under the feet seen at pixels of the footage, and its standard
    deviation: those of the first region that holds them, else 0.
    """
    height_m, sigma_m = np.zeros(len(uv)), np.zeros(len(uv))
    free = np.ones(len(uv), bool)
    for region in regions:
        rows = free & region.contains(uv)
        height_m[rows], sigma_m[rows] = region.height_m, region.sigma_m
        free &= ~rows
    return height_m, sigma_m
