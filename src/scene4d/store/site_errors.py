"""What the cameras of a site err by together: places, clocks and calibrations in one covariance.

Two cameras that saw the same people put them into the same place, wherever that is: most of what
each errs by they have in common. Standard deviations camera by camera make a distance between two
people whom different cameras see two to three times less certain than it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.calibration import PARAMETERS, Calibration
from scene4d.core.json_object import JsonObject
from scene4d.core.placement import PLACED, Placement

TOLD: tuple[str, ...] = (*PLACED, *PARAMETERS)
"""Order of the rows of each camera; ``log_scale`` is what the calibration's errors do not make."""
_SIZE = len(TOLD)
_LEAST = 1e-13
"""Variances below this share of the largest are rounding."""
_ASYMMETRIC = 1e-6


@dataclass(frozen=True, eq=False)
class SiteErrors:
    """The covariance of :data:`TOLD` of these cameras, one after the other."""

    cameras: tuple[str, ...]
    covariance: Float[np.ndarray, "k k"]

    @classmethod
    def none(cls) -> "SiteErrors":
        """Of no camera."""
        return cls((), np.zeros((0, 0)))

    @classmethod
    def alone(cls, camera: str, placement: Placement, calibration: Calibration) -> "SiteErrors":
        """One camera whose place and calibration err independently."""
        covariance = np.zeros((_SIZE, _SIZE))
        covariance[: len(PLACED), : len(PLACED)] = placement.covariance
        covariance[len(PLACED) :, len(PLACED) :] = calibration.parameter_covariance
        return cls((camera,), covariance)

    def beside(self, other: "SiteErrors") -> "SiteErrors":
        """With other cameras, which err independently of these."""
        n, m = len(self.covariance), len(other.covariance)
        covariance = np.zeros((n + m, n + m))
        covariance[:n, :n], covariance[n:, n:] = self.covariance, other.covariance
        return SiteErrors((*self.cameras, *other.cameras), covariance)

    def then(self, frame: Placement, placements: Mapping[str, Placement]) -> "SiteErrors":
        """In the frame that ``frame`` puts the site into; ``placements`` are those before."""
        inner, outer = np.eye(len(self.covariance)), np.zeros((len(self.covariance), len(PLACED)))
        for k, name in enumerate(self.cameras):
            one, at = placements[name], k * _SIZE
            inner[at : at + 2, at : at + 2] = frame.linear
            outer[at : at + len(PLACED)] = np.eye(len(PLACED))
            outer[at : at + 2] = frame.point_jacobian(np.array([[one.x_m, one.y_m]]))[0]
        covariance = inner @ self.covariance @ inner.T + outer @ frame.covariance @ outer.T
        return replace(self, covariance=covariance)

    def of(self, camera: str, other: str) -> Float[np.ndarray, "12 12"]:
        """The covariance of the errors of one camera with those of another."""
        rows, columns = self._rows(camera), self._rows(other)
        return self.covariance[rows, columns]

    def modes_m(
        self,
        camera: str,
        placement: Placement,
        calibration: Calibration,
        xy_m: Float[np.ndarray, "n 2"],
        velocity_mps: Float[np.ndarray, "n 2"] | None = None,
    ) -> Float[np.ndarray, "n 2 r"]:
        """By how much points of a camera's own ground move in the site per standard deviation of
        each of the site's independent errors; NaN where the camera sees no ground.

        Differences of the modes of two points, whichever cameras see them, are those of the way
        between them. Velocities are the camera's own, of what moves (:meth:`.point_jacobian`).
        """
        slopes = np.zeros((len(xy_m), 2, _SIZE))
        slopes[:, :, : len(PLACED)] = placement.point_jacobian(xy_m, velocity_mps)
        if calibration.covariance is not None and len(xy_m):
            uv, _ = calibration.ground_pixels(xy_m)
            _, jacobian, seen = calibration.ground_jacobian(uv)
            jacobian[~seen] = np.nan
            slopes[:, :, len(PLACED) :] = placement.linear @ jacobian
        modes: np.ndarray = slopes @ self._root[self._rows(camera)]
        return modes

    @cached_property
    def _root(self) -> Float[np.ndarray, "k r"]:
        scale = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        unit = np.where(scale > 0, scale, 1.0)
        size, axes = np.linalg.eigh(self.covariance / np.outer(unit, unit))
        kept = size > _LEAST * max(float(size.max(initial=0.0)), 1e-300)
        root: np.ndarray = unit[:, None] * axes[:, kept] * np.sqrt(size[kept])
        return root

    def _rows(self, camera: str) -> slice:
        at = self.cameras.index(camera) * _SIZE
        return slice(at, at + _SIZE)

    def to_dict(self) -> dict[str, Any]:
        """The field ``errors`` of ``site.json``."""
        matrix = [[float(f"{value:.9g}") for value in row] for row in self.covariance.tolist()]
        return {"cameras": list(self.cameras), "parameters": list(TOLD), "matrix": matrix}

    @classmethod
    def read(cls, said: JsonObject, placed: list[str]) -> "SiteErrors":
        """Read the field; raises :class:`InputError` naming what is wrong with it."""
        cameras = said.texts("cameras")
        if sorted(cameras) != sorted(placed):
            raise said.error("cameras", f"those that have a place: {', '.join(placed)}")
        if said.texts("parameters") != TOLD:
            raise said.error("parameters", ", ".join(TOLD))
        n = _SIZE * len(cameras)
        matrix = said.array("matrix", n, n)
        most = float(np.abs(matrix).max(initial=0.0))
        if np.abs(matrix - matrix.T).max(initial=0.0) > _ASYMMETRIC * most or (
            n and np.linalg.eigvalsh(matrix)[0] < -_ASYMMETRIC * most
        ):
            raise said.error("matrix", "that of a covariance: symmetric, and no negative variance")
        return cls(cameras, matrix)
