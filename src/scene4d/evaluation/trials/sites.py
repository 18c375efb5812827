"""A site against the true poses of its cameras."""

import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.alignment import align
from scene4d.calibration.calibrating import calibrate
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.progress import Progress
from scene4d.drawing.site_map import Way, ways_of
from scene4d.evaluation.measures._site import (
    Agreement,
    GroundError,
    PairError,
    agreement,
    aligned_truth,
    ground_error,
    pair_errors,
)
from scene4d.formats.cameras import read_camera
from scene4d.store.site import Site
from scene4d.store.site_file import is_site
from scene4d.tracking import track
from scene4d.video.frames import VIDEO_SUFFIXES

_CAMERA_FILES = (".json", ".krtd", ".xml", ".yml", ".yaml", ".ci", ".txt")
_OFFSETS = "offsets.json"
_WAY_STEP_S = 0.5


@dataclass(frozen=True, eq=False)
class SiteEvaluation:
    """Errors of a site: between each two cameras, of people whom several saw, on the ground."""

    name: str
    site: Site
    true: Mapping[str, Camera]
    pairs: tuple[PairError, ...]
    people: Agreement
    ground: GroundError | None
    notes: tuple[str, ...] = ()
    aligned: Mapping[str, Camera] = field(default_factory=dict)
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    ways: Sequence[Way] = ()

    def to_dict(self) -> dict[str, Any]:
        """Content of ``evaluation.json``, and the fields of ``--json``."""
        d, ground = self.people.distance_m, self.ground
        undetermined = {n: str(p.reason) for n, p in self.site.placements.items() if not p}
        return {
            "name": "site",
            "pairs": [pair.to_dict() for pair in self.pairs],
            "undetermined": undetermined,
            "people": {
                "seen_by_several": self.people.people,
                "moments": len(d),
                "median_m": float(np.median(d)) if len(d) else None,
                "p90_m": float(np.quantile(d, 0.9)) if len(d) else None,
            },
            "ground_error_m": None
            if ground is None
            else {
                "site": ground.site_m,
                "cameras_refined": ground.refined_m,
                "cameras_alone": ground.alone_m,
            },
            "notes": list(self.notes),
        }


def evaluate_site(data: str | Path, site: str | Path | None, progress: Progress) -> SiteEvaluation:
    """Compare a site with the true cameras in the folder ``data``.

    A true camera is a file of any known format named as the camera is, or with the same number at
    the end (``0.json`` for ``cam0``). ``site`` is a folder that ``align`` wrote; without it one in
    ``data`` is taken, or else the scenes there are aligned, or the videos there calibrated, tracked
    and aligned, told nothing. Footage is taken as synchronised unless ``offsets.json`` there has
    the seconds to add to each clock. Raises :class:`InputError` where there is no truth or nothing
    to compare.
    """
    folder = Path(data)
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder; expected true cameras and a site")
    with tempfile.TemporaryDirectory(prefix="scene4d-site-") as work:
        opened = _site(folder, site, Path(work), progress)
        true = _truth(folder, tuple(opened.placements))
        offsets, notes = _offsets(folder)
        return SiteEvaluation(
            folder.resolve().name,
            opened,
            true,
            tuple(pair_errors(opened, true, offsets)),
            agreement(opened) if opened.cameras else Agreement(np.zeros(0), 0),
            ground_error(opened, true),
            notes,
            aligned_truth(opened, true),
            {name: opened.camera(name) for name in opened.cameras},
            ways_of(opened.tracks(step_s=_WAY_STEP_S), opened.identities.cameras_each())
            if opened.cameras
            else (),
        )


def _site(folder: Path, site: str | Path | None, work: Path, progress: Progress) -> Site:
    if site is not None:
        return Site.open(site)
    inside = [folder, *sorted(path for path in folder.iterdir() if path.is_dir())]
    sites = [path for path in inside if is_site(path)]
    if sites:
        return Site.open(sites[0])
    scenes = [path for path in inside if (path / "runs").is_dir()]
    if not scenes:
        videos = sorted(path for path in folder.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
        scenes = [_scene(video, work / video.stem, progress) for video in videos]
    if not scenes:
        raise InputError(f"{folder}: holds no site, no scenes and no videos to make one of")
    return align(scenes, work / "site", progress=progress, pictures=False).site


def _scene(video: Path, out: Path, progress: Progress) -> Path:
    found = calibrate(video, progress=progress)
    if not found:
        raise InputError(f"{video}: the camera is undetermined: {found.reason}")
    track(video, found, out, name=video.stem, progress=progress)
    return out


def _truth(folder: Path, names: tuple[str, ...]) -> dict[str, Camera]:
    true: dict[str, Camera] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in _CAMERA_FILES or path.name in (_OFFSETS, "site.json"):
            continue
        for name in names:
            if _is_of(path.stem, name) and path.is_file():
                camera = read_camera(path)
                if isinstance(camera, Camera):
                    true[name] = camera
    if len(true) < 2:
        raise InputError(
            f"{folder}: holds the true cameras of {len(true)} of {', '.join(names)}; expected two "
            "or more files named as the cameras are, or with the same number at the end"
        )
    return true


def _is_of(stem: str, camera: str) -> bool:
    if stem == camera:
        return True
    numbers = [re.search(r"\d+$", text) for text in (stem, camera)]
    told = [int(number[0]) for number in numbers if number is not None]
    return len(told) == 2 and told[0] == told[1]


def _offsets(folder: Path) -> tuple[dict[str, float], tuple[str, ...]]:
    path = folder / _OFFSETS
    if not path.exists():
        return {}, ("The footage is taken as synchronised: the true time offsets are 0.",)
    said = JsonObject.read(path)
    return {name: said.number(name) for name in said.names()}, ()
