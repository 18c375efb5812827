"""``align``: several scenes become one site: one ground, one clock, one number for each person."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.alignment._anchors import Anchored, tied
from scene4d.alignment._graph import Solution, solve
from scene4d.alignment._identity import identified, passages_of
from scene4d.alignment._joint import errors_together, refined
from scene4d.alignment._options import AlignOptions
from scene4d.alignment._pairs import Link, link
from scene4d.alignment._paths import View, view_of
from scene4d.alignment._pictures import site_pictures
from scene4d.alignment._reading import Watched, apart, gap_between_s, site_start_ns, watched
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.placement import Placement
from scene4d.core.progress import Progress, Silent, timed
from scene4d.core.tracks import Tracks
from scene4d.formats.anchors import Anchors, read_anchors
from scene4d.store.identities import Identities
from scene4d.store.regrounding import in_site, regrounded
from scene4d.store.site import Site
from scene4d.store.site_errors import SiteErrors
from scene4d.store.site_file import SiteAnchor, SiteCamera, SiteFile
from scene4d.store.site_writing import write_site

_DRIFT_TOLD_S = 0.1
"""Clocks that drift apart by less than this over the footage are not worth a word."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """What ``align`` found: the site, what each pair of cameras says, and in words what to mind.

    False, with the ``reason``, if no two cameras could be placed.
    """

    site: Site
    pairs: tuple[dict[str, Any], ...]
    reason: str | None = None
    warnings: tuple[str, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return self.reason is None

    def to_dict(self) -> dict[str, Any]:
        """Ready for ``json.dumps``: as ``site.json`` without ``errors``, the pairs, and counts."""
        known = self.site.identities
        cameras = known.cameras_each()
        return {
            "site": str(self.site.folder),
            **{k: v for k, v in self.site.to_dict().items() if k not in ("schema", "errors")},
            "pairs": list(self.pairs),
            "tracks": len(known),
            "identities": len(cameras),
            "seen_by_several": sum(count > 1 for count in cameras.values()),
            "reason": self.reason,
        }


@dataclass(frozen=True, eq=False)
class _Read:
    """A camera with what it tracked, on its clock; no tracks where nobody was seen."""

    watched: Watched
    calibration: Calibration
    tracks: Tracks | None
    view: View | None


@dataclass(frozen=True, eq=False)
class _Placed:
    """A camera with its place, and its calibration if the site tells it better than its file."""

    read: _Read
    placement: Placement
    refined: Calibration | None = None

    @property
    def name(self) -> str:
        """The camera's in the site."""
        return self.read.watched.name

    def camera(self) -> Camera:
        """In the site's frame."""
        known = (self.refined or self.read.calibration).camera
        assert known is not None
        return self.placement.camera(known)

    def own_tracks(self) -> Tracks | None:
        """What it tracked, on its own ground."""
        found = self.read.tracks
        if found is None or self.refined is None:
            return found
        return regrounded(found, self.read.calibration, self.refined)

    def tracks(self) -> Tracks | None:
        """The same on the site's ground and clock; None without a place."""
        found = self.own_tracks()
        return in_site(found, self.placement) if found is not None and self.placement else None


def align(
    scenes: Sequence[str | Path],
    out: str | Path,
    options: AlignOptions | None = None,
    *,
    progress: Progress | None = None,
    **more: Any,
) -> Alignment:
    """Find where the cameras of several scenes stand to each other, and write the site ``out``.

    From the tracks alone: people whom two cameras saw tell where one lies to the other, how its
    clock is off and by how much its metre differs. ``scenes`` are folders that ``track`` wrote.
    Options are those of :class:`AlignOptions`, in one or by their names. What is not determined
    says so, with the reason, in the site's file. Raises :class:`InputError` for scenes that cannot
    be read, one that is given twice, and fewer than two cameras, and :class:`OutputError` where the
    site cannot be written.
    """
    options = replace(options or AlignOptions(), **more)
    progress = progress or Silent()
    timings: dict[str, float] = {}
    if (Path(out) / "runs").is_dir():
        raise InputError(f"{out}: is the folder of a scene; give the site a folder of its own")
    cameras, warnings = watched(scenes)
    start_ns = site_start_ns(cameras)
    anchors = None if options.anchor is None else read_anchors(options.anchor)
    with timed(timings, "read"), progress.stage("Reading tracks", len(cameras)) as step:
        read = []
        for one in cameras:
            read.append(_read(one, start_ns))
            step(1)
    with timed(timings, "pairs"):
        links = _links(read, start_ns, options, progress)
    with timed(timings, "site"):
        solution = _solved(read, links)
        found = _placed(read, solution, links)
        errors = _errors(read, solution)
        anchor = None
        if anchors is not None:
            found, anchor, errors = _anchored(found, anchors, errors)
        warnings += _about(read, solution)
        if anchor is not None and not anchor:
            warnings.append(f"the site has a frame of its own, off the map: {anchor.reason}")
    with timed(timings, "identities"), progress.stage("Recognising people", None):
        identities = _identities(found)
    said = SiteFile({one.name: _entry(one) for one in found}, start_ns, anchor, errors)
    better = {one.name: one.refined for one in found if one.refined is not None}
    with timed(timings, "pictures"):
        lines = [one.xy_m for one in anchors.lines] if anchors is not None and anchor else []
        pictures = _pictures(found, identities, lines, progress) if options.pictures else {}
    with timed(timings, "write"):
        write_site(Path(out), said, identities, refined=better, pictures=pictures)
    placements = [one.placement for one in found]
    reason = None if any(placements) else _nothing(placements)
    pairs = tuple(_told(one, read, solution) for one in links)
    return Alignment(Site.open(out), pairs, reason, tuple(warnings), timings)


def _read(one: Watched, start_ns: int | None) -> _Read:
    calibration, tracks = one.calibration(), one.tracks(start_ns)
    view = None if tracks is None else view_of(one.name, tracks, calibration)
    return _Read(one, calibration, tracks, view)


def _links(
    read: Sequence[_Read], start_ns: int | None, options: AlignOptions, progress: Progress
) -> list[Link]:
    """What each two cameras say of each other."""
    pairs = list(combinations(range(len(read)), 2))
    found = []
    bounds = (-options.max_offset_s, options.max_offset_s)
    with progress.stage("Comparing cameras", len(pairs)) as step:
        for i, j in pairs:
            a, b = read[i], read[j]
            reason = apart(a.watched, b.watched, start_ns, options.max_offset_s)
            if reason is None and a.view is not None and b.view is not None:
                found.append(_with_gap(link(a.view, b.view, (i, j), bounds), a, b, start_ns))
            else:
                found.append(Link(i, j, reason=reason))
            step(1)
    return found


def _with_gap(said: Link, a: _Read, b: _Read, start_ns: int | None) -> Link:
    """With a word if two cameras that are not aligned never recorded at one time."""
    gap_s = gap_between_s(a.watched, b.watched, start_ns)
    if said or gap_s is None or gap_s <= 0:
        return said
    why = f"no common moment: by their clocks {gap_s:.0f} s lie between the two, and {said.reason}"
    return replace(said, reason=why)


def _solved(read: Sequence[_Read], links: Sequence[Link]) -> Solution | None:
    """The site of the cameras in which anybody was tracked."""
    there = [k for k, one in enumerate(read) if one.view is not None]
    if not any(links):
        return None
    number = {k: place for place, k in enumerate(there)}
    inside = [
        replace(one, a=number[one.a], b=number[one.b])
        for one in links
        if one.a in number and one.b in number
    ]
    return solve([read[k].view for k in there], inside)  # type: ignore[misc]


def _placed(
    read: Sequence[_Read], solution: Solution | None, links: Sequence[Link]
) -> list[_Placed]:
    """Every camera with its place, and its calibration where the site tells it better."""
    if solution is None:
        whys = [Placement.undetermined(_why(k, links)) for k in range(len(read))]
        return [_Placed(one, why) for one, why in zip(read, whys, strict=True)]
    views = [one.view for one in read if one.view is not None]
    places = iter(zip(solution.placements, refined(views, solution), strict=True))
    found = []
    for one in read:
        if one.view is None:
            found.append(_Placed(one, Placement.undetermined("nobody was tracked by this camera")))
            continue
        placement, better = next(places)
        if better is None:
            found.append(_Placed(one, placement))
        else:
            found.append(_Placed(one, better.placement, better.calibration))
    return found


def _errors(read: Sequence[_Read], solution: Solution | None) -> SiteErrors:
    """What the placed cameras err by together."""
    views = [one.view for one in read if one.view is not None]
    return SiteErrors.none() if solution is None else errors_together(views, solution)


def _anchored(
    cameras: Sequence[_Placed], anchors: Anchors, errors: SiteErrors
) -> tuple[list[_Placed], SiteAnchor, SiteErrors]:
    """The cameras in the frame of the anchors, with what they err by together."""
    found, anchor, errors = tied(
        {
            one.name: Anchored(
                one.refined or one.read.calibration,
                one.placement,
                one.own_tracks(),
                one.read.watched.start_known,
            )
            for one in cameras
        },
        anchors,
        errors,
    )
    return [replace(one, placement=found[one.name]) for one in cameras], anchor, errors


def _why(camera: int, links: Sequence[Link]) -> str:
    """Why no pair places a camera: its own reason, or the most frequent one."""
    said = [str(one.reason) for one in links if camera in (one.a, one.b)]
    return max(said, key=said.count)


def _nothing(placements: Sequence[Placement]) -> str:
    reasons = [str(one.reason) for one in placements]
    return max(reasons, key=reasons.count)


def _about(read: Sequence[_Read], solution: Solution | None) -> list[str]:
    """What is to be minded: pairs that contradict the others, clocks that drift."""
    if solution is None:
        return []
    there = [one for one in read if one.view is not None]
    said = []
    for one, reason in solution.rejected:
        a, b = there[one.a].watched.name, there[one.b].watched.name
        said.append(f"cameras {a!r} and {b!r}: left out, {reason}")
    for one in solution.used:
        if one.note is not None:
            a, b = there[one.a].watched.name, there[one.b].watched.name
            said.append(f"cameras {a!r} and {b!r}: {one.note}")
    for camera, placement in zip(there, solution.placements, strict=True):
        assert camera.view is not None
        drift, span_s = placement.drift, float(np.ptp(camera.view.time_s))
        if drift is not None and abs(drift.rate) * span_s > _DRIFT_TOLD_S:
            way = "slow" if drift.rate > 0 else "fast"
            said.append(
                f"camera {camera.watched.name!r}: its clock is {way} "
                f"by {abs(drift.rate) * 3600:.2f} ± {drift.sigma * 3600:.2f} s an hour against the "
                "site's, which is taken off"
            )
    return said


def _identities(cameras: Sequence[_Placed]) -> Identities:
    """Everybody whom a camera with a place saw."""
    seen = [(one.name, one.tracks()) for one in cameras]
    return identified([passages_of(name, tracks) for name, tracks in seen if tracks is not None])


def _pictures(
    cameras: Sequence[_Placed],
    identities: Identities,
    lines: Sequence[np.ndarray],
    progress: Progress,
) -> dict[str, bytes]:
    """The plan and the pairs; none where no camera has a place."""
    there = [(one, one.tracks()) for one in cameras if one.placement]
    if not there:
        return {}
    with progress.stage("Drawing the site", None) as step:
        return site_pictures(
            {one.name: one.camera() for one, _ in there},
            {one.name: one.placement for one, _ in there},
            {
                one.name: identities.of(one.name).numbered(tracks)
                for one, tracks in there
                if tracks is not None
            },
            {one.name: one.read.watched.runs for one, _ in there},
            identities,
            lines,
            step,
        )


def _entry(one: _Placed) -> SiteCamera:
    watched = one.read.watched
    tracked = {run.run: run.tracked() for run in watched.runs}
    return SiteCamera(
        watched.folder, watched.file, watched.camera, tuple(tracked), one.placement, tracked
    )


def _told(one: Link, read: Sequence[_Read], solution: Solution | None) -> dict[str, Any]:
    """A pair for JSON."""
    names = [read[k].watched.name for k in (one.a, one.b)]
    said: dict[str, Any] = {"cameras": names, "status": "ok" if one else "undetermined"}
    if not one:
        return said | {"reason": one.reason}
    return said | {"people_in_common": len(one.pairs), "score": one.score}
