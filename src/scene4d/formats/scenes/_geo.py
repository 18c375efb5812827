"""Where a scene lies on the Earth: from the metres of its world to longitude and latitude."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError, UnavailableError
from scene4d.core.geometry.alignment import rigid_fit

# Chosen by hand: what somebody who reads points off an aerial photograph gets right.
_EXPECTED_ERROR_M = 1.0
"""How far off a point on the ground is: read from a map, and seen by the camera."""
_EXPECTED_SCALE_ERROR = 0.03
"""How far off the camera's metre is: 5 cm of the mean height of the people who walk by."""
_MOST_SCALE = 1.25
"""Factor by which distances may disagree, either way, before the anchor is refused; no error of
the mean height explains more."""
WARN_AT, REFUSE_AT = 3.0, 6.0
"""Distance of a point from where the anchor puts it, in expected errors."""
_LEAST_SPREAD_M = 1.0
"""Points closer to one another than this give no direction: their own error is as large."""


@dataclass(frozen=True)
class GeoAnchor:
    """A rotation and a shift of the ground onto the Earth (WGS 84); never a scale.

    ``latitude_deg``, ``longitude_deg`` are the centre of an azimuthal equidistant projection of
    the ellipsoid, ``rotation_rad`` the angle from east to the world's +X, anticlockwise, and
    ``east_m``, ``north_m`` the world's origin in the projection. ``scale`` is the factor from the
    world's metres to the Earth's that would have fitted best, ``residual_m`` how far each anchor
    point lies from where the anchor puts it. Metres are those of the ellipsoid: at a height of h
    metres the ground is longer by h / 6.37e6, 4 mm in 100 m at 250 m.
    """

    latitude_deg: float
    longitude_deg: float
    rotation_rad: float
    east_m: float
    north_m: float
    scale: float
    residual_m: tuple[float, ...]

    @classmethod
    def fit(
        cls,
        xy_m: Float[np.ndarray, "n 2"],
        lat_deg: Float[np.ndarray, "n"],
        lon_deg: Float[np.ndarray, "n"],
    ) -> "GeoAnchor":
        """The anchor that brings ground points (n, 2), n at least 2, to where they are known to be.

        Least squares over rotation and shift
        (:func:`~scene4d.core.geometry.alignment.rigid_fit`). Warns where a point is off by three
        expected errors; raises :class:`InputError` beyond six, where distances disagree by more
        than 1.25, for fewer than two points, points within 1 m, points without a ground position
        and degrees out of range, and :class:`UnavailableError` without pyproj.
        """
        _check_points(xy_m, lat_deg, lon_deg)
        earth, centre = earth_metres(lat_deg, lon_deg)
        _check_spread("in the scene", xy_m)
        _check_spread("by their latitude and longitude", earth)
        R, shift = rigid_fit(xy_m, earth)
        arm = xy_m - xy_m.mean(axis=0)
        scale = float(np.sum((arm @ R.T) * earth) / np.sum(arm**2))
        _check_scale(scale, xy_m, earth)
        residual = np.linalg.norm(xy_m @ R.T + shift - earth, axis=1)
        expected = np.hypot(_EXPECTED_ERROR_M, _EXPECTED_SCALE_ERROR * np.linalg.norm(arm, axis=1))
        _check_residual(residual, expected, scale)
        return cls(
            latitude_deg=centre[0],
            longitude_deg=centre[1],
            rotation_rad=float(np.arctan2(R[1, 0], R[0, 0])),
            east_m=float(shift[0]),
            north_m=float(shift[1]),
            scale=scale,
            residual_m=tuple(residual.tolist()),
        )

    @classmethod
    def at(cls, latitude_deg: float, longitude_deg: float) -> "GeoAnchor":
        """The anchor of a frame whose +X is east and +Y north of this point."""
        return cls(latitude_deg, longitude_deg, 0.0, 0.0, 0.0, 1.0, ())

    def to_lonlat(self, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Longitude and latitude (n, 2) in degrees of ground points; NaN stays NaN.

        Raises :class:`UnavailableError` without pyproj.
        """
        c, s = np.cos(self.rotation_rad), np.sin(self.rotation_rad)
        earth = xy_m @ np.array([[c, s], [-s, c]]) + np.array([self.east_m, self.north_m])
        project = _projection(self.latitude_deg, self.longitude_deg)
        known = np.isfinite(earth).all(axis=1)
        lonlat = np.full(xy_m.shape, np.nan)
        lonlat[known] = np.column_stack(project(*earth[known].T, inverse=True))
        return lonlat

    def azimuth_deg(self, heading_rad: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Directions (from +X to +Y) as degrees clockwise from north, 0 to 360.

        North is that of the projection's centre; a kilometre from it, true north differs by
        0.009° times the tangent of the latitude.
        """
        azimuth: np.ndarray = np.mod(90.0 - np.degrees(heading_rad + self.rotation_rad), 360.0)
        return azimuth


def earth_metres(
    lat_deg: Float[np.ndarray, "n"], lon_deg: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 2"], tuple[float, float]]:
    """Metres east and north of the middle of some points of the Earth, and its latitude and
    longitude. Raises :class:`UnavailableError` without pyproj.
    """
    turn = (lon_deg - lon_deg[0] + 180.0) % 360.0 - 180.0  # the mean holds at 180° too
    centre = float(lat_deg.mean()), _wrapped(float(lon_deg[0] + turn.mean()))
    return np.column_stack(_projection(*centre)(lon_deg, lat_deg)), centre


def _projection(latitude_deg: float, longitude_deg: float) -> Any:
    try:
        from pyproj import Proj
    except ImportError as error:
        raise UnavailableError(
            "longitude and latitude need pyproj: pip install 'scene4d[geo]'"
        ) from error
    return Proj(proj="aeqd", ellps="WGS84", lat_0=latitude_deg, lon_0=longitude_deg)


def _wrapped(longitude_deg: float) -> float:
    return (longitude_deg + 180.0) % 360.0 - 180.0


def _check_points(xy_m: np.ndarray, lat_deg: np.ndarray, lon_deg: np.ndarray) -> None:
    n = len(xy_m)
    if n < 2:
        raise InputError(
            f"geo-anchor: {n} point{'' if n == 1 else 's'} cannot turn the scene towards north; "
            "expected two or more, far apart"
        )
    for i in range(n):
        where = f"geo-anchor: point {i + 1}"
        lat, lon = lat_deg[i], lon_deg[i]
        if not np.isfinite(xy_m[i]).all():
            raise InputError(f"{where} has no ground position; does its pixel lie on the ground?")
        if not (abs(lat) <= 90 and abs(lon) <= 180):
            swapped = abs(lon) <= 90 and abs(lat) <= 180
            hint = "; are they swapped?" if swapped else ""
            raise InputError(
                f"{where}: latitude {lat:g}, longitude {lon:g}; expected -90 to 90 and "
                f"-180 to 180 degrees{hint}"
            )


def _largest_distance(points: np.ndarray) -> float:
    return float(np.linalg.norm(points[:, None] - points[None], axis=2).max())


def _check_spread(where: str, points: np.ndarray) -> None:
    spread = _largest_distance(points)
    if spread < _LEAST_SPREAD_M:
        raise InputError(
            f"geo-anchor: its points lie within {spread:.2f} m {where} and give no direction; "
            "choose points far apart"
        )


def _check_scale(scale: float, xy_m: np.ndarray, earth: np.ndarray) -> None:
    if not 1 / _MOST_SCALE <= scale <= _MOST_SCALE:
        raise InputError(
            f"geo-anchor: its distances disagree: up to {_largest_distance(xy_m):.1f} m in the "
            f"scene, {_largest_distance(earth):.1f} m by latitude and longitude, and a scale of "
            f"{scale:.2f} would fit best (accepted: {1 / _MOST_SCALE:.2f} to {_MOST_SCALE:.2f}). "
            "Does each latitude and longitude belong to its point? Points far apart help"
        )


def _check_residual(residual: np.ndarray, expected: np.ndarray, scale: float) -> None:
    worst = int(np.argmax(residual / expected))
    ratio = residual[worst] / expected[worst]
    if ratio <= WARN_AT:
        return
    text = (
        f"geo-anchor: point {worst + 1} lies {residual[worst]:.1f} m from where the points "
        f"together put it; expected about {expected[worst]:.1f} m (a scale of {scale:.2f} would "
        "fit best). Does its latitude and longitude belong to it?"
    )
    if ratio > REFUSE_AT:
        raise InputError(text)
    warnings.warn(text, stacklevel=3)
