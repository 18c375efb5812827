"""What a page is of: scenes, each camera on a ground of its own, or a site with one for all."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from scene4d.core.calibration import Calibration
from scene4d.core.ground_regions import GroundRegion
from scene4d.core.tracks import Tracks
from scene4d.searching import opened as open_places
from scene4d.store.query import Scene
from scene4d.store.runs import Run
from scene4d.store.site import RunClock, Site
from scene4d.store.site_file import is_site

_ROUNDING_S = 1e-6


@dataclass(frozen=True, eq=False)
class Shown:
    """A run as the page shows it: what the camera is called, its calibration in the page's frame,
    the first and last time of a row on the page's clock, what to add to the clip's time for that
    (in the middle, where a clock drifts), and when it was 0 (UTC).
    """

    run: Run
    camera: str
    calibration: Calibration
    span_s: tuple[float, float]
    shift_s: float = 0.0
    start: datetime | None = None


class Opened:
    """The runs of scenes, or of a site, in which somebody was tracked: in scenes that are
    ``growing`` there may be none. Raises :class:`InputError` as :func:`opened_places`.
    """

    def __init__(self, folders: Sequence[Path], *, growing: bool = False) -> None:
        self.whole = opened_places(folders, growing=growing)
        site = self.whole if isinstance(self.whole, Site) else None
        self.site = site
        self.shown = _of_site(site) if site else _of_scene(self._scene)

    @property
    def _scene(self) -> Scene:
        assert isinstance(self.whole, Scene)
        return self.whole

    @property
    def cameras(self) -> tuple[str, ...]:
        """Their names on the page."""
        return tuple(dict.fromkeys(one.camera for one in self.shown))

    @property
    def rows(self) -> int:
        """How many rows all runs have."""
        return sum(one.run.rows for one in self.shown)

    def own(self, one: Shown) -> Calibration:
        """A run's calibration in metres of its own, as it was made."""
        if self.site is not None:
            return self.site.calibration(one.camera)
        return Calibration.load(self._scene.camera_file(one.run.camera))

    def tracks(self, one: Shown, since_s: float | None = None) -> Tracks:
        """Rows of a run in the page's frame and on its clock, from ``since_s`` on."""
        if self.site is None:
            scene = self._scene.only(one.run.run)
            return scene.tracks(keypoints=False, begin=since_s)
        begin_s, end_s = one.span_s
        begin_s = begin_s if since_s is None else max(begin_s, since_s)
        begin_s, end_s = begin_s - _ROUNDING_S, end_s + _ROUNDING_S
        return self.site.camera_tracks(one.camera, keypoints=False, begin=begin_s, end=end_s)

    def fused(self) -> Tracks | None:
        """Everybody of a site once, whichever of several cameras saw them; None for scenes."""
        return None if self.site is None else self.site.tracks()

    @property
    def anchor(self) -> dict[str, float] | None:
        """Latitude and longitude (degrees) of the origin, where the frame is tied to the Earth."""
        anchor = None if self.site is None else self.site.anchor
        if anchor is None or anchor.latitude_deg is None or anchor.longitude_deg is None:
            return None
        return {"latitude_deg": anchor.latitude_deg, "longitude_deg": anchor.longitude_deg}

    def placement(self, camera: str) -> dict[str, Any]:
        """The place of a site's camera: its origin (m) and the covariance of x, y, heading and the
        logarithm of the scale; nothing in a scene.
        """
        if self.site is None:
            return {}
        one = self.site.placements[camera]
        covariance = one.covariance[:4, :4].tolist()
        return {"placement": {"x_m": one.x_m, "y_m": one.y_m, "covariance": covariance}}

    @property
    def unplaced(self) -> dict[str, str]:
        """Cameras of a site whose place is not known, and why."""
        placements = {} if self.site is None else self.site.placements
        return {name: str(one.reason) for name, one in placements.items() if not one}


def opened_places(folders: Sequence[Path], *, growing: bool) -> Scene | Site:
    """As :func:`.searching.opened`; scenes that are ``growing`` may be empty."""
    if growing and not any(map(is_site, folders)):
        return Scene.growing(*folders)
    return open_places(*folders)


def _of_scene(scene: Scene) -> list[Shown]:
    known = {name: Calibration.load(scene.camera_file(name)) for name in scene.cameras}
    return [
        Shown(
            run,
            run.camera,
            known[run.camera],
            run.span_s or (0.0, 0.0),
            start=run.start,
        )
        for run in scene.runs
        if run.rows
    ]


def _of_site(site: Site) -> list[Shown]:
    return [
        _shown(run, name, _in_site(site, name), clock, site.start)
        for name in site.cameras
        for run, clock in site.runs(name)
        if run.rows
    ]


def _shown(
    run: Run, name: str, calibration: Calibration, clock: RunClock, start: datetime | None
) -> Shown:
    begin_s, end_s = run.span_s or (0.0, 0.0)
    span_s = clock.in_site(begin_s), clock.in_site(end_s)
    return Shown(run, name, calibration, span_s, clock.middle_shift_s(run.span_s), start)


def _in_site(site: Site, name: str) -> Calibration:
    """A calibration whose camera stands in the site's frame, in metres of the site."""
    known, scale = site.calibration(name), site.placements[name].scale
    regions = [
        GroundRegion(one.polygon_uv, one.height_m * scale, one.sigma_m * scale)
        for one in known.ground_regions
    ]
    return replace(
        known,
        camera=site.camera(name),
        person_height_m=known.person_height_m * scale,
        ground_regions=tuple(regions),
    )
