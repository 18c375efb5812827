"""What each camera does now: of a scene that is watched, and of a site that could not place it."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from scene4d.app._opened import Opened
from scene4d.store.status import Status, status_path, watched_cameras

_BEHIND_S = 2.0
"""An analysis whose newest frame is older is behind; less is the time of one look or two."""


def fleet_of(opened: Opened, folders: Sequence[Path]) -> list[dict[str, Any]]:
    """The state of each camera: that of its :class:`Status`, ``behind``, ``silent``, ``unplaced``,
    or ``recorded`` where it was never watched.
    """
    now = datetime.now(UTC)
    found = [
        {"camera": shown, "pictured": _pictured(picture_of(opened, folders, shown))}
        | _state(_latest(camera, scenes), now)
        for shown, (camera, scenes) in _where(opened, folders).items()
    ]
    return found + [
        {"camera": name, "pictured": None, "state": "unplaced", "reason": reason}
        for name, reason in opened.unplaced.items()
    ]


def picture_of(opened: Opened, folders: Sequence[Path], camera: str) -> Path | None:
    """The newest small picture of a camera; None if it was never watched."""
    name, scenes = _where(opened, folders)[camera]
    paths = [status_path(scene, name, "jpg") for scene in scenes]
    there = [path for path in paths if path.exists()]
    return max(there, key=lambda path: path.stat().st_mtime_ns, default=None)


def _where(opened: Opened, folders: Sequence[Path]) -> dict[str, tuple[str, Sequence[Path]]]:
    """By their names on the page: cameras' names in their scenes, and these."""
    if opened.site is None:
        watched = (name for folder in folders for name in watched_cameras(folder))
        return {name: (name, folders) for name in dict.fromkeys([*opened.cameras, *watched])}
    placed = {name: opened.site.placed(name) for name in opened.cameras}
    return {name: (one.name, [one.scene]) for name, one in placed.items()}


def _latest(camera: str, scenes: Sequence[Path]) -> Status | None:
    found = [one for scene in scenes if (one := Status.load(scene, camera)) is not None]
    return max(found, key=lambda one: one.written, default=None)


def _state(status: Status | None, now: datetime) -> dict[str, Any]:
    if status is None:
        return {"state": "recorded", "reason": None}
    said: dict[str, Any] = {"state": status.state, "reason": status.reason}
    said |= {"dropped": round(status.dropped / max(status.offered, 1), 2)}
    silent_s = status.silent_s(now)
    if silent_s is not None:
        return said | {"state": "silent", "for_s": round(silent_s)}
    if status.state == "live" and status.behind_s > _BEHIND_S:
        return said | {"state": "behind", "for_s": round(status.behind_s)}
    return said


def _pictured(path: Path | None) -> int | None:
    """When it was made: another number is another picture."""
    return None if path is None else path.stat().st_mtime_ns // 1_000_000
