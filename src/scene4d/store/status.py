"""What each camera that is watched does at the moment.

    SCENE/status/CAMERA.json    its state, written every second
    SCENE/status/CAMERA.jpg     a small picture of what it shows, every ten seconds

Both are replaced and never add up. A camera that was tracked from a recording has neither.
"""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from scene4d.core.files import write_json
from scene4d.core.json_object import JsonObject
from scene4d.store.runs import file_name

STATUS_SCHEMA = "scene4d/status/1"
STATES = ("live", "lost", "moved", "calibrating", "refused", "ended")
_SILENT_S = {"live": 10.0, "lost": 10.0, "moved": 10.0, "calibrating": 300.0, "refused": 300.0}
"""Without a word for so long a camera is silent: its process died or hangs. While it calibrates no
word comes for a minute on a slow machine."""


@dataclass(frozen=True)
class Status:
    """One camera: ``lost`` is its stream, ``moved`` its view; it is ``calibrating`` again, and
    ``refused`` with a ``reason`` where that failed. ``behind_s`` is how old the newest frame was
    that had been analysed, ``offered`` and ``dropped`` count frames, ``reconnected`` how often the
    stream came back, and ``written`` is when this was so.
    """

    camera: str
    run: str
    state: str
    reason: str | None
    behind_s: float
    offered: int
    dropped: int
    reconnected: int
    written: datetime

    def silent_s(self, now: datetime) -> float | None:
        """For how long no word has come (s), if that is too long; None otherwise."""
        age_s = (now - self.written).total_seconds()
        return age_s if age_s > _SILENT_S.get(self.state, float("inf")) else None

    def save(self, scene: Path) -> None:
        """Replace the camera's file; raises :class:`OutputError` if it cannot be written."""
        said: dict[str, Any] = {"schema": STATUS_SCHEMA} | asdict(self)
        write_json(status_path(scene, self.camera), said | {"written": self.written.isoformat()})

    @classmethod
    def load(cls, scene: Path, camera: str) -> "Status | None":
        """The status of a camera; None if it was never watched. Raises :class:`InputError` naming a
        missing or wrong field.
        """
        path = status_path(scene, camera)
        if not path.exists():
            return None
        said = JsonObject.read(path, STATUS_SCHEMA)
        if said.text("state") not in STATES:
            raise said.error("state", ", ".join(STATES))
        return cls(
            camera=said.text("camera"),
            run=said.text("run"),
            state=said.text("state"),
            reason=said.text("reason") if "reason" in said else None,
            behind_s=said.number("behind_s", least=0.0),
            offered=said.integer("offered", least=0),
            dropped=said.integer("dropped", least=0),
            reconnected=said.integer("reconnected", least=0),
            written=_moment(said),
        )


def watched_cameras(scene: Path) -> list[str]:
    """The cameras that are or were watched, whoever was there; raises as :meth:`Status.load`."""
    files = sorted((scene / "status").glob("*.json"))
    return [JsonObject.read(path, STATUS_SCHEMA).text("camera") for path in files]


def status_path(scene: Path, camera: str, ending: str = "json") -> Path:
    """Where the status of a camera is, or with ``jpg`` its picture."""
    return scene / "status" / f"{file_name(camera, 'camera')}.{ending}"


def _moment(said: JsonObject) -> datetime:
    try:
        written = datetime.fromisoformat(said.text("written"))
    except ValueError:
        raise said.error("written", "a time such as 2026-11-20T08:00:00+00:00") from None
    return written if written.tzinfo else written.replace(tzinfo=UTC)
