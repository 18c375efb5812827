"""What a watched camera does, said in its scene once a second for whoever looks at many cameras."""

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from scene4d.core.errors import OutputError, Scene4DError
from scene4d.core.files import write_bytes
from scene4d.core.pictures import jpeg
from scene4d.store.status import Status, status_path

if TYPE_CHECKING:
    from scene4d.video.frames import Frame
    from scene4d.video.live import LiveSource

_EVERY_S, _PICTURED_S = 1.0, 10.0
_WIDTH_PX, _QUALITY = 384, 75
"""A tile of a screen full of cameras: some 15 kB."""


class Pulse:
    """Writes ``status/`` of a scene. Leaving its ``with`` block says that the camera has ended, and
    for what reason if that is an error.
    """

    def __init__(self, live: "LiveSource", scene: Path) -> None:
        self._live, self._scene = live, scene
        self._camera = self._run = ""
        self._state = "live"
        self._reason: str | None = None
        self._said_s = self._pictured_s = -float("inf")

    def __enter__(self) -> "Pulse":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, _: object) -> None:
        reason = str(error) if isinstance(error, Scene4DError) else None
        try:
            self.say("ended", reason)
        except OutputError:
            if kind is None:  # else the first error is the one to tell
                raise

    def begin(self, camera: str, run: str) -> None:
        """Another run; where it is another camera's, the one before has ended."""
        if self._camera not in ("", camera):
            self.say("ended", f"its view has moved; it is camera {camera} now")
        self._camera, self._run = camera, run
        status_path(self._scene, camera).parent.mkdir(parents=True, exist_ok=True)
        self.say("live")

    def say(self, state: str, reason: str | None = None) -> None:
        """From now on the camera is in this state."""
        self._state, self._reason, self._said_s = state, reason, -float("inf")
        self.beat()

    def beat(self) -> None:
        """Say again that it is, if a second has passed."""
        now_s, live = time.monotonic(), self._live
        if not self._camera or now_s < self._said_s + _EVERY_S:
            return
        self._said_s = now_s
        watching = self._state == "live"
        Status(
            camera=self._camera,
            run=self._run,
            state="lost" if watching and live.is_lost else self._state,
            reason=self._reason,
            behind_s=round(max(0.0, live.now_s - live.taken_s), 2) if watching else 0.0,
            offered=live.offered,
            dropped=live.dropped,
            reconnected=live.reconnected,
            written=datetime.now(UTC),
        ).save(self._scene)

    def show(self, frame: "Frame", *, away: bool) -> None:
        """The newest frame, and whether its view is another than the calibrated one."""
        state = "moved" if away else "live"
        if state != self._state:
            self.say(state)
        now_s = time.monotonic()
        if now_s < self._pictured_s + _PICTURED_S:
            return
        self._pictured_s = now_s
        scale = _WIDTH_PX / frame.image_bgr.shape[1]
        picture = jpeg(frame.image_bgr, _QUALITY, scale)
        write_bytes(status_path(self._scene, self._camera, "jpg"), picture)
