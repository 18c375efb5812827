"""How soon an alert comes: python -m benchmarks.alert_latency [--data DIR] [--rate 5] [--rounds 1]

Street footage is played at real time and watched with the networks, with searches that find much
on it, and a webhook on this machine. The table has the time from an event's end to its alert.
"""

import json
import tempfile
import threading
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np

from benchmarks import options_of
from benchmarks.tables import Rows, machine, markdown
from scene4d import calibrate
from scene4d.tracking import TrackOptions, watch

CLIPS = ("crosswalk_640x352_13s", "plaza_960x540_14s", "road_shadows_854x480_31s")
SEARCHES = (
    "person stops",
    "vehicle stops",
    "vehicle starts",
    "person disappears",
    "person turns left",
)
LEAST = 0.1
"""Scores do not matter here: more events say more about the time that they take."""
ALLOWED_S = 3.0


class Hook(BaseHTTPRequestHandler):
    """Notes when in the footage the events end that are sent, and the delays."""

    told: list[tuple[float, float]]

    def do_POST(self):
        now = datetime.now(UTC)
        event = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        ended = datetime.fromisoformat(event["end_time"])
        Hook.told.append((event["end_s"], (now - ended).total_seconds()))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_):
        """Nothing."""


def delays(clip: Path, camera: Path, rate_hz: float, scratch: Path) -> tuple[list[float], float]:
    """Seconds from the ends of events to their alerts, and the share of frames that were dropped.

    What ends in the last seconds of a clip is left out: when it is over nothing is waited for.
    """
    Hook.told = []
    with (
        tempfile.TemporaryDirectory(dir=scratch) as scene,
        ThreadingHTTPServer(("127.0.0.1", 0), Hook) as server,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        run = watch(
            clip, camera, scene, searches=SEARCHES, min_score=LEAST,
            alerts=[f"http://127.0.0.1:{server.server_address[1]}"],
            tracking=TrackOptions(rate_hz=rate_hz),
        )  # fmt: skip
        server.shutdown()
    found = [delay_s for end_s, delay_s in Hook.told if end_s <= run.end_s - ALLOWED_S]
    return found, run.dropped / max(run.offered, 1)


def row(name: str, found: list[float], dropped: str) -> list[str]:
    if not found:
        return [name, "0", "", "", "", dropped]
    median, ninth = np.quantile(found, [0.5, 0.9])
    soon = np.mean(np.array(found) <= ALLOWED_S)
    return [name, str(len(found)), f"{median:.1f} s", f"{ninth:.1f} s", f"{soon:.0%}", dropped]


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--rate", type=float, default=5.0)
    parser.add_argument("--rounds", type=int, default=1)
    asked = parser.parse_args()
    rows: Rows = [["footage", "alerts", "median", "90 %", f"within {ALLOWED_S:g} s", "dropped"]]
    every: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in CLIPS:
            clip = asked.data / "footage" / "streets" / f"{name}.mp4"
            camera = Path(folder) / f"{name}.json"
            calibrate(clip).save(camera)
            found: list[float] = []
            for _ in range(asked.rounds):
                new, dropped = delays(clip, camera, asked.rate, Path(folder))
                found += new
            rows.append(row(name, found, f"{dropped:.0%}"))
            every += found
    rows.append(row("all", every, ""))
    print(machine())
    print(markdown(rows))


if __name__ == "__main__":
    main()
