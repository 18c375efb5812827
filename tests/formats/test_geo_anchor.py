"""The geo-anchor against geodesics, and against the origin of the MEVA cameras' frame."""

import sys
import warnings

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyproj import Geod, Transformer

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError, UnavailableError
from scene4d.formats.cameras import read_camera
from scene4d.formats.scenes import GeoAnchor

GEOD = Geod(ellps="WGS84")
SQUARE = np.array([[0.0, 5.0], [30.0, 8.0], [-12.0, 40.0], [25.0, 60.0]])


def on_earth(xy, lat, lon, azimuth_of_y):
    """Latitudes and longitudes of points of a world whose origin and +Y are known, by geodesics."""
    x, y = np.asarray(xy, float).T
    azimuth = azimuth_of_y + np.degrees(np.arctan2(x, y))
    n = len(x)
    found = GEOD.fwd(np.full(n, lon), np.full(n, lat), azimuth, np.hypot(x, y))
    return found[1], found[0]


def apart_m(lonlat_a, lonlat_b):
    return GEOD.inv(*lonlat_a.T, *lonlat_b.T)[2]


latitudes, longitudes = st.floats(-85, 85), st.floats(-180, 180)


@settings(max_examples=60)
@example(-16.8, 180.0, 0.0, 100.0, 0.0)  # Fiji, on both sides of the 180th meridian
@example(-16.8, -180.0, 0.0, 100.0, 0.0)
@given(latitudes, longitudes, st.floats(-180, 180), st.floats(-300, 300), st.floats(-300, 300))
def test_points_lie_where_geodesics_say(lat, lon, azimuth, x, y):
    anchor = GeoAnchor.fit(SQUARE, *on_earth(SQUARE, lat, lon, azimuth))
    assert anchor.scale == pytest.approx(1, abs=1e-6)
    assert max(anchor.residual_m) < 1e-3
    point = np.array([[x, y]])
    expected = np.column_stack(on_earth(point, lat, lon, azimuth)[::-1])
    assert apart_m(anchor.to_lonlat(point), expected)[0] < 2e-3


@settings(max_examples=60)
@given(latitudes, longitudes, st.floats(-np.pi, np.pi), st.floats(0, 360), st.floats(1, 300))
def test_distances_and_bearings_agree_with_geodesics(lat, lon, rotation, bearing, distance):
    """From the projection's centre, where north is true north."""
    anchor = GeoAnchor(lat, lon, rotation, 0.0, 0.0, 1.0, ())
    heading = np.radians(90 - bearing) - rotation
    xy = distance * np.array([[0.0, 0.0], [np.cos(heading), np.sin(heading)]])
    here, there = anchor.to_lonlat(xy)
    azimuth, _, found = GEOD.inv(*here, *there)
    assert found == pytest.approx(distance, abs=1e-3)
    across = np.radians((azimuth - bearing + 180) % 360 - 180) * distance
    assert abs(across) < 1e-3
    named = anchor.azimuth_deg(np.array([heading]))[0]
    assert 0 <= named <= 360
    assert abs((named - bearing + 180) % 360 - 180) < 1e-6


def test_two_points_fix_rotation_and_shift():
    two = SQUARE[:2]
    anchor = GeoAnchor.fit(two, *on_earth(two, 48.1, 11.5, 77.0))
    expected = np.column_stack(on_earth(SQUARE, 48.1, 11.5, 77.0)[::-1])
    assert apart_m(anchor.to_lonlat(SQUARE), expected).max() < 1e-3


def test_noise_is_spread_and_reported():
    """A point that is 2 m off: within three expected errors, so neither refused nor warned of."""
    lat, lon = on_earth(SQUARE, 48.1, 11.5, 77.0)
    lon[2], lat[2], _ = GEOD.fwd(lon[2], lat[2], 30.0, 2.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        anchor = GeoAnchor.fit(SQUARE, lat, lon)
    assert 0.5 < max(anchor.residual_m) < 2
    assert int(np.argmax(anchor.residual_m)) == 2


@pytest.mark.parametrize(("off", "kind"), [(8.0, UserWarning), (25.0, InputError)])
def test_a_point_in_the_wrong_place_is_named(off, kind):
    lat, lon = on_earth(SQUARE, 48.1, 11.5, 77.0)
    lon[2], lat[2], _ = GEOD.fwd(lon[2], lat[2], 347.0, off)
    catch = pytest.warns if kind is UserWarning else pytest.raises
    with catch(kind, match=r"point 3 lies \d+\.\d m from where"):
        GeoAnchor.fit(SQUARE, lat, lon)


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("points", [2, 4])
def test_distances_that_disagree_are_refused_with_the_numbers(factor, points):
    xy = SQUARE[:points]
    lat, lon = on_earth(factor * xy, 48.1, 11.5, 77.0)
    with pytest.raises(InputError, match=rf"scale of {factor:.2f} would fit best") as error:
        GeoAnchor.fit(xy, lat, lon)
    if points == 2:
        assert f"up to {np.hypot(30, 3):.1f} m in the scene" in str(error.value)
        assert f"{factor * np.hypot(30, 3):.1f} m by latitude" in str(error.value)


def test_a_mirrored_scene_is_refused():
    mirrored = SQUARE * [-1.0, 1.0]
    with pytest.raises(InputError, match="geo-anchor: "):
        GeoAnchor.fit(SQUARE, *on_earth(mirrored, 48.1, 11.5, 77.0))


@pytest.mark.parametrize(
    ("xy", "lat", "lon", "message"),
    [
        ([[1.0, 2]], [48.0], [11.0], "1 point cannot turn the scene"),
        (np.empty((0, 2)), [], [], "0 points cannot turn the scene"),
        ([[1.0, 2], [1.2, 2]], [48.0, 48.1], [11.0, 11.0], "lie within 0.20 m in the scene"),
        ([[1.0, 2], [9, 2]], [48.0, 48.0], [11.0, 11.0], "lie within 0.00 m by their latitude"),
        ([[1.0, 2], [9, 2]], [-122.4, -122.4], [37.7, 37.8], "point 1: .*are they swapped"),
        ([[1.0, 2], [9, 2]], [48.0, 91.0], [11.0, 200.0], "point 2: latitude 91, longitude 200"),
        ([[1.0, 2], [9, 2]], [48.0, np.nan], [11.0, 11.0], "point 2: latitude nan"),
        ([[1.0, 2], [np.nan, 2]], [48.0, 48.1], [11.0, 11.0], "point 2 has no ground position"),
    ],
)
def test_bad_points_are_refused(xy, lat, lon, message):
    with pytest.raises(InputError, match=message):
        GeoAnchor.fit(np.array(xy, float), np.array(lat, float), np.array(lon, float))


def test_nan_stays_nan():
    anchor = GeoAnchor(48.0, 11.0, 0.3, 1.0, 2.0, 1.0, ())
    found = anchor.to_lonlat(np.array([[np.nan, 1.0], [1.0, 1.0]]))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()
    assert anchor.to_lonlat(np.empty((0, 2))).shape == (0, 2)


def test_without_pyproj_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(UnavailableError, match=r"pip install 'scene4d\[geo\]'"):
        GeoAnchor.fit(SQUARE, np.linspace(48.0, 48.001, 4), np.full(4, 11.0))


def test_meva_cameras_lie_where_their_origin_says(shared_data):
    """Their frame is east, north, up at geo_origin.txt; PROJ's topocentric conversion inverts it.

    That one knows the height (242 m above the ellipsoid), which makes the ground longer by
    h / 6.37e6; the anchor measures on the ellipsoid, so it may differ by that much and no more.
    """
    folder = shared_data / "meva"
    lat, lon, height = (float(x) for x in (folder / "geo_origin.txt").read_text().split())
    frame = f"+proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0={height}"
    to_earth = Transformer.from_pipeline(
        f"+proj=pipeline +step +inv {frame} +step +inv +proj=cart +ellps=WGS84 "
        "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    cameras = [read_camera(path) for path in sorted((folder / "cameras").glob("*.krtd"))]
    centres = np.array([c.centre_m for c in cameras if isinstance(c, Camera)])
    assert len(centres) >= 4
    east, north = centres[:, 0], centres[:, 1]
    expected = np.column_stack(to_earth.transform(east, north, np.zeros(len(east)))[:2])
    anchor = GeoAnchor.fit(
        np.array([[0.0, 0.0], [0.0, 100.0]]), *on_earth([[0.0, 0.0], [0.0, 100.0]], lat, lon, 0.0)
    )
    off = apart_m(anchor.to_lonlat(centres[:, :2]), expected)
    reach = np.hypot(east, north)
    assert reach.max() > 50
    np.testing.assert_array_less(off, reach * height / 6.37e6 * 1.05 + 0.002)
    fitted = GeoAnchor.fit(centres[:, :2], expected[:, 1], expected[:, 0])
    assert fitted.scale == pytest.approx(1 - height / 6.37e6, abs=2e-6)
    assert abs(np.degrees(fitted.rotation_rad)) < 0.02
