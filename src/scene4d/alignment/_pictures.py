"""Pictures of a site: the plan, and for each pair of cameras what one saw in the other's view."""

import logging
from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path

import numpy as np

from scene4d.alignment._sameness import TICK_S
from scene4d.core.camera import Camera
from scene4d.core.errors import Scene4DError
from scene4d.core.placement import Placement
from scene4d.core.progress import Advance
from scene4d.core.tracks import Tracks
from scene4d.drawing.other_view import Matched, draw_other_view
from scene4d.drawing.site_map import draw_site_map, ways_of
from scene4d.store.fusing import fused
from scene4d.store.identities import Identities
from scene4d.store.runs import Run, file_name
from scene4d.video.reader import open_source

_LOG = logging.getLogger(__name__)
PLAN = "plan.png"
_LEAST_MOMENTS = 4
_MOST_PAIRS = 24
"""Pairs of views that are drawn: those with most people in common."""


def site_pictures(
    cameras: Mapping[str, Camera],
    placements: Mapping[str, Placement],
    seen: Mapping[str, Tracks],
    runs: Mapping[str, Sequence[Run]],
    identities: Identities,
    lines: Sequence[np.ndarray],
    step: Advance,
) -> dict[str, bytes]:
    """PNG files by their names in the site: ``plan.png`` and ``pairs/A in B.png``.

    ``cameras`` stand in the site's frame, and ``seen`` is what each tracked there, by identity;
    ``lines`` are those of a map that the site is tied to.
    """
    covariances = {name: one.covariance[:2, :2] for name, one in placements.items()}
    ways = ways_of(fused(list(seen.values()), TICK_S), identities.cameras_each())
    pictures = {PLAN: draw_site_map(cameras, covariances, ways, lines=lines).png}
    step(1)
    moments = {name: fused([tracks], TICK_S) for name, tracks in seen.items()}
    pairs = {(a, b): _matched(cameras[a], moments[a], moments[b]) for a, b in permutations(seen, 2)}
    told = sorted(pairs, key=lambda pair: -len(pairs[pair].own_uv))[:_MOST_PAIRS]
    frames: dict[str, np.ndarray | None] = {}
    for a, b in told:
        if len(pairs[a, b].own_uv) < _LEAST_MOMENTS:
            continue
        if a not in frames:
            frames[a] = first_frame(runs[a], cameras[a].image_size)
        picture = draw_other_view(frames[a], cameras[a].image_size, pairs[a, b], (a, b))
        name = file_name(f"{b} in {a}", "picture").replace("%20", " ")
        pictures[f"pairs/{name}.png"] = picture.png
    return pictures


def _matched(camera: Camera, own: Tracks, other: Tracks) -> Matched:
    """The same people at the same moments, as seen by this camera and by another, in its pixels."""
    span = max(int(max(own.frame.max(initial=0), other.frame.max(initial=0))) + 1, 1)
    low = min(int(min(own.frame.min(initial=0), other.frame.min(initial=0))), 0)
    keys = [one.track * (span - low) + one.frame - low for one in (own, other)]
    _, i, j = np.intersect1d(*keys, return_indices=True)
    uv = [
        camera.project(np.column_stack([xy, np.zeros(len(xy))]))[0]
        for xy in (own.xy_m[i], other.xy_m[j])
    ]
    known = np.isfinite(uv[0]).all(axis=1) & np.isfinite(uv[1]).all(axis=1)
    return Matched(uv[0][known], uv[1][known])


def first_frame(runs: Sequence[Run], image_size: tuple[int, int]) -> np.ndarray | None:
    """A frame of the footage, if it is still where it was tracked."""
    for run in runs:
        source = run.provenance.get("source")
        if not isinstance(source, str) or not Path(source).exists():
            continue
        try:
            footage = open_source(source)
            frame = next(iter(footage.frames(None)), None)
        except Scene4DError as error:
            _LOG.debug("%s", error)
            continue
        if frame is not None and frame.image_bgr.shape[1::-1] == image_size:
            return frame.image_bgr
    return None
