"""A scene in the format of another program."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError

if TYPE_CHECKING:
    from scene4d.formats.scenes import GeoAnchor, SceneTable
    from scene4d.store.query import Scene
    from scene4d.store.site import Site


_STRETCH_S = 600.0
"""Length of the part of a scene in memory, for formats that are written line by line."""


@dataclass(frozen=True)
class GroundPoint:
    """A pixel on the ground with its latitude and longitude, in degrees."""

    u: float
    v: float
    lat_deg: float
    lon_deg: float


def export_scene(
    scene: str | Path,
    out: str | Path,
    to: str,
    *,
    run: str | None = None,
    anchor: Sequence[GroundPoint] = (),
) -> tuple[Path, ...]:
    """Write one run of a scene (by name, or the only one) and return the files written.

    ``anchor`` are two or more ground points with known latitude and longitude. Raises
    :class:`InputError` if there is no such run or the points disagree, and as
    :func:`.write_scene`.
    """
    from scene4d.formats.scenes import write_scene
    from scene4d.store.query import Scene

    everything = Scene.open(scene)
    names = [one.run for one in everything.runs]
    if run is None and len(names) > 1:
        raise InputError(f"{scene}: holds {len(names)} runs, name one: {', '.join(names)}")
    chosen = everything.only(run or names[0])
    if not len(chosen):
        raise InputError(f"{scene}: run {chosen.runs[0].run!r} is empty: nobody was tracked")
    return write_scene(_pieces(chosen, anchor), out, to)


OF_THE_GROUND = ("csv", "geojson", "moving-features")
"""Formats that a site can be written in: the others hold boxes, which belong to one picture."""


def export_site(site: str | Path, out: str | Path, to: str) -> tuple[Path, ...]:
    """Write everybody in a site, by identity, in a format of :data:`OF_THE_GROUND`.

    Raises :class:`InputError` for another format, for longitudes and latitudes of a site that is
    not anchored to the Earth, and as :func:`.write_scene`.
    """
    from scene4d.formats.scenes import write_scene
    from scene4d.store.site import Site

    opened = Site.open(site)
    if to not in OF_THE_GROUND:
        raise InputError(
            f"{to} holds boxes in the picture of one camera; a site can be written as "
            f"{', '.join(OF_THE_GROUND)}"
        )
    earth = opened.anchor and opened.anchor.kind == "earth"
    if to == "geojson" and not earth:
        raise InputError(
            f"{site}: where the site lies on the Earth is not known; align it again with an anchor "
            "of points with longitude and latitude, or export moving-features, which takes metres"
        )
    return write_scene(_site_pieces(opened), out, to)


def _site_pieces(site: "Site") -> "Iterator[SceneTable]":
    """The site's fused tracks in stretches of time."""
    from scene4d.formats.scenes import GeoAnchor, SceneTable

    anchor, geo = site.anchor, None
    if anchor is not None and anchor.latitude_deg is not None and anchor.longitude_deg is not None:
        geo = GeoAnchor.at(anchor.latitude_deg, anchor.longitude_deg)
    size = site.calibration(site.cameras[0]).image_size if site.cameras else (1, 1)
    for tracks in site.stretches(_STRETCH_S):
        name = site.folder.resolve().name
        yield SceneTable(tracks, camera=name, image_size=size, start_utc=site.start, geo=geo)


def is_scene(path: Path) -> bool:
    """Whether this is the folder of a scene."""
    return (path / "runs").is_dir()


def _pieces(scene: "Scene", points: Sequence[GroundPoint]) -> "Iterator[SceneTable]":
    """The run in stretches of time."""
    from scene4d.formats.scenes import SceneTable
    from scene4d.store.schema import with_keypoints

    (run,) = scene.runs
    camera = Camera.load(scene.camera_file(run.camera))
    geo = _anchored(camera, points) if points else None
    begin = min(part.begin_s for part in run.parts)
    end = max(part.end_s for part in run.parts)
    while begin <= end:
        tracks = with_keypoints(scene.tracks(begin=begin, end=begin + _STRETCH_S), run.keypoints)
        begin += _STRETCH_S
        if not len(tracks):  # the gap may be years
            later = f"SELECT min(time_s) AS s FROM scene WHERE time_s >= '{begin!r}'::DOUBLE"
            (found,) = scene.sql(later)["s"].to_pylist()
            begin = np.inf if found is None else found
            continue
        yield SceneTable(
            tracks,
            camera=run.camera,
            image_size=camera.image_size,
            start_utc=run.start,
            keypoint_names=tracks.keypoint_names,
            geo=geo,
            calibrated=camera,
        )


def _anchored(camera: Camera, points: Sequence[GroundPoint]) -> "GeoAnchor":
    """The position of the camera's world on the Earth; raises :class:`InputError` if the points
    disagree or one of them does not lie on the ground.
    """
    from scene4d.formats.scenes import GeoAnchor

    uv = np.array([[p.u, p.v] for p in points])
    xy, on_ground = camera.locate(uv)
    bad = np.flatnonzero(~on_ground)
    if len(bad):
        raise InputError(
            f"anchor {bad[0] + 1}: pixel ({uv[bad[0], 0]:g}, {uv[bad[0], 1]:g}) does "
            "not lie on the ground; give pixels below the horizon"
        )
    return GeoAnchor.fit(
        xy, np.array([p.lat_deg for p in points]), np.array([p.lon_deg for p in points])
    )
