"""``watch``: cameras that run, are slow, are lost, move, and processes that are killed."""

import base64
import json
import os
import signal
import socketserver
import struct
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import groupby
from pathlib import Path
from typing import ClassVar

import av
import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from scene4d.calibration.calibrating import Run
from scene4d.cli.app import app
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError, OutputError
from scene4d.core.files import write_bytes
from scene4d.formats.cameras import read_camera
from scene4d.perception.objects import ObjectDetector
from scene4d.searching.kept import keep_search
from scene4d.store.query import Scene
from scene4d.store.status import Status
from scene4d.tracking import TrackOptions, watch_several
from scene4d.tracking.live import watch
from scene4d.video.frames import Frame
from scene4d.video.live import LiveSource
from walks import CAMERA, FPS, ground, write_video

HERE = Path(__file__).parents[1]


def seen_while_running(detector, scene: Path, at: int):
    """A perfect detector; at a frame it opens the scene as another process would."""
    used, found = detector(), []
    look = used.look

    def also(frame):
        if frame.index >= at and not found:
            one = Scene.open(scene)
            before = [k / FPS for k in used.seen if int(k / FPS) < int(frame.time_s)]
            found.append((one.runs[0].span_s[1], before[-1], len(one.tracks())))
        return look(frame)

    used.look = also
    return found


def test_what_is_watched_is_read_meanwhile(tmp_path, camera, detector, paced):
    found = seen_while_running(detector, tmp_path / "scene", 24)
    run = watch(write_video(tmp_path / "yard.avi", seconds=3), camera, tmp_path / "scene")
    ((published_s, analysed_s, rows),) = found
    assert published_s >= analysed_s - 1e-6, "all seconds before this one are published"
    assert rows > 0
    assert (run.offered, run.dropped) == (3 * FPS, 0)
    assert run.tracks == {"person": 2, "car": 1}
    scene = Scene.open(tmp_path / "scene")
    assert len(scene) == run.rows == 3 * run.offered
    names = [path.name for path in tmp_path.rglob("*.parquet")]
    assert len(names) == 1, "parts that were replaced are gone"
    assert not names[0].startswith(".")


def test_a_file_plays_at_real_time_and_a_slow_analysis_takes_the_newest_frame(
    tmp_path, camera, detector
):
    used, begun_s = detector(), time.monotonic()
    look = used.look
    used.look = lambda frame: (time.sleep(0.3), look(frame))[1]
    run = watch(write_video(tmp_path / "yard.avi", seconds=2), camera, tmp_path / "scene")
    assert time.monotonic() - begun_s > 1.8
    assert run.offered == 2 * FPS
    assert run.dropped >= 9
    assert len(used.seen) == run.offered - run.dropped
    assert used.seen[-1] == 2 * FPS - 1
    assert f"{run.dropped} of 20 frames were dropped" in run.warnings[-1]


def play_yard(out) -> None:
    """A second of the yard as MPEG-TS, at real time."""
    picture = av.VideoFrame.from_ndarray(ground(), format="bgr24")
    with suppress(OSError), av.open(out, "w", format="mpegts") as file:
        stream = file.add_stream("mpeg2video", rate=25)
        stream.height, stream.width = ground().shape[:2]
        stream.pix_fmt, stream.gop_size = "yuv420p", 5
        begun_s = time.monotonic()
        for number in range(30):
            time.sleep(max(0, begun_s + number / 25 - time.monotonic()))
            picture.pts = number
            file.mux(stream.encode(picture))
            out.flush()
        file.mux(stream.encode(None))


class Camera(BaseHTTPRequestHandler):
    """Plays the yard to each of two visitors."""

    visits = 0

    def do_GET(self):
        if Camera.visits == 2:
            self.send_error(503)
            return
        Camera.visits += 1
        self.send_response(200)
        self.end_headers()
        play_yard(self.wfile)

    def log_message(self, *_):
        """Nothing."""


class RtspCamera(socketserver.StreamRequestHandler):
    """The same over RTSP (RFC 2326), with RTP in the same connection."""

    description = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=yard\r\nt=0 0\r\nm=video 0 RTP/AVP 33\r\n"

    def handle(self):
        while head := self.rfile.readline():
            asked = iter(self.rfile.readline, b"\r\n")
            fields = dict(line.decode().strip().lower().split(": ", 1) for line in asked)
            kind, body, more = head.split()[0], "", ["Session: 1"]
            if kind == b"DESCRIBE":
                Camera.visits += 1
                body, more = self.description, ["Content-Type: application/sdp"]
            elif kind == b"SETUP":
                more.append("Transport: RTP/AVP/TCP;unicast;interleaved=0-1")
            said = "200 OK" if Camera.visits <= 2 else "503 Service Unavailable"
            lines = [f"RTSP/1.0 {said}", f"CSeq: {fields['cseq']}", *more]
            lines += [f"Content-Length: {len(body)}", "", body]
            self.wfile.write("\r\n".join(lines).encode())
            if kind == b"PLAY":
                play_yard(Rtp(self.wfile))
                return


class Rtp:
    """Seven packets of MPEG-TS in one of RTP (RFC 2250)."""

    def __init__(self, file) -> None:
        self.file, self.rest, self.number = file, b"", 0
        self.flush = file.flush

    def write(self, content: bytes) -> int:
        self.rest += content
        while len(self.rest) >= 1316:
            head = struct.pack(">BBHII", 0x80, 33, self.number & 0xFFFF, self.number * 90, 1)
            self.file.write(struct.pack(">cBH", b"$", 0, 1328) + head + self.rest[:1316])
            self.rest, self.number = self.rest[1316:], self.number + 1
        return len(content)


@pytest.fixture(params=["http", "rtsp"])
def server(request):
    Camera.visits = 0
    kinds = {"http": (ThreadingHTTPServer, Camera), "rtsp": (RtspServer, RtspCamera)}
    kind, handler = kinds[request.param]
    with kind(("127.0.0.1", 0), handler) as served:
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield f"{request.param}://127.0.0.1:{served.server_address[1]}/yard.ts"
        served.shutdown()


class RtspServer(socketserver.ThreadingTCPServer):
    daemon_threads = True


def test_a_stream_that_is_lost_is_opened_again(tmp_path, camera, detector, server, caplog):
    detector()
    run = watch(server, camera, tmp_path / "scene", give_up_s=0.5)
    assert run.reconnected == 1
    assert "did not come back" in " ".join(run.warnings)
    assert [text for text in caplog.messages if "is back after" in text]
    scene = Scene.open(tmp_path / "scene")
    begin, end = scene.runs[0].span_s
    assert end - begin > 1, "the clock went on while there was no stream"


def test_several_cameras_are_watched_into_one_scene(tmp_path, camera, detector, paced):
    detector()
    videos = [write_video(tmp_path / f"{name}.avi", seconds=2) for name in ("gate", "yard")]
    words = [*map(str, videos), *(["--camera", str(camera)] * 2), "--out", str(tmp_path / "s")]
    done = CliRunner().invoke(app, ["watch", *words])
    assert done.exit_code == 0, done.output
    assert done.output.count("2 x person, 1 x car") == 2
    scene = Scene.open(tmp_path / "s")
    assert sorted(run.camera for run in scene.runs) == ["gate", "yard"]
    assert len(np.unique(scene.tracks().track)) == 6
    told = CliRunner().invoke(app, ["watch", *words, "--name", "one"])
    assert "2 sources, 2 cameras and 1 names" in told.output


def test_an_error_of_one_camera_ends_all(tmp_path, camera, detector, endless):
    detector()
    videos = [write_video(tmp_path / "yard.avi", seconds=1), tmp_path / "none.avi"]
    with pytest.raises(InputError, match=r"none.avi"):
        watch_several(videos, [camera] * 2, tmp_path / "s")


def test_sigterm_ends_it_normally(tmp_path, camera, detector, endless):
    used = detector()
    look = used.look

    def ends(frame):
        if frame.index >= 12 and not used.until:
            used.until = 10**6
            os.kill(os.getpid(), signal.SIGTERM)
        return look(frame)

    used.look = ends
    video = write_video(tmp_path / "yard.avi", seconds=1)
    words = ["watch", str(video), "--camera", str(camera), "--out", str(tmp_path / "s")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "2 x person" in done.output
    assert signal.getsignal(signal.SIGTERM) is not None
    assert len([index for index in used.seen if index >= 12]) <= 2
    assert len(Scene.open(tmp_path / "s")) > 0


def test_a_full_disk_is_one_error_and_what_was_published_stays(
    tmp_path, camera, detector, paced, monkeypatch
):
    used, writes = detector(), []

    def fills_up(path, content):
        writes.append(path)
        if len(writes) > 2:
            raise OutputError(f"{path}: cannot be written: No space left on device")
        write_bytes(path, content)

    monkeypatch.setattr("scene4d.store.writing.write_bytes", fills_up)
    video = write_video(tmp_path / "yard.avi", seconds=5)
    with pytest.raises(OutputError, match="No space left"):
        watch(video, camera, tmp_path / "scene")
    assert 0 < Scene.open(tmp_path / "scene").runs[0].span_s[1] < used.seen[-1] / FPS


def test_jumps_of_the_clock_do_not_reach_the_rows(tmp_path, camera, detector, paced, monkeypatch):
    """An hour forwards after a second, and an hour back after another."""
    used, hours = detector(), [0]
    look = used.look

    class Clock(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(hours=hours[0])

    def jumps(frame):
        hours[0] = int(frame.index >= 10) - 2 * int(frame.index >= 20)
        return look(frame)

    used.look = jumps
    for module in ("video.live", "tracking.live", "tracking._pulse"):
        monkeypatch.setattr(f"scene4d.{module}.datetime", Clock)
    watch(write_video(tmp_path / "yard.avi", seconds=3), camera, tmp_path / "scene")
    scene = Scene.open(tmp_path / "scene")
    (run,) = scene.runs
    assert run.span_s == pytest.approx((0.0, 2.9))
    assert len(run.watched) == 1
    moments = scene.tracks().time_s * 1e9 + run.start_ns
    assert np.abs(moments - time.time_ns()).max() < 1800e9
    assert hours == [-1]


class Scripted(LiveSource):
    """Two frames a second of a ground that lies elsewhere for a while, as fast as they go."""

    shifts: ClassVar[list[int]] = []

    def start(self):
        """Nothing runs."""

    def take(self, timeout_s):
        if self.offered == len(self.shifts):
            self.stop()
            return None
        self.offered += 1
        index = self.offered - 1
        self.taken_s = index / 2
        return Frame(index, self.taken_s, ground(self.shifts[index]))


@pytest.fixture
def scripted(tmp_path, camera, monkeypatch):
    """Watch with these shifts of the view, one each half second."""
    monkeypatch.setattr("scene4d.video.live.LiveSource", Scripted)
    monkeypatch.setattr("scene4d.tracking._running._drawn", lambda *_: None)
    cv2.imwrite(str(camera.with_name("background.jpg")), ground())

    def watched(shifts, **options):
        Scripted.shifts = shifts
        video = write_video(tmp_path / "yard.avi", seconds=1)
        named = TrackOptions(name="y")
        return watch(video, camera, tmp_path / "scene", tracking=named, **options)

    return watched


def test_nobody_is_tracked_while_the_view_is_another(scripted, detector, caplog):
    used = detector()
    run = scripted([0] * 12 + [24] * 32 + [0] * 16)
    assert 15 < run.not_in_view_s < 18
    times = [index / 2 for index in used.seen]
    assert not [t for t in times if 9 < t < 22]
    assert [t for t in times if t < 6]
    assert [t for t in times if t > 28]
    assert "has moved by 2" in caplog.text
    assert "the view is back" in caplog.text


def test_a_view_that_has_moved_is_calibrated_again_and_known_when_it_is_back(
    tmp_path, scripted, detector, caplog, monkeypatch
):
    """The first attempt is refused; the second gives a camera; then the first view is back."""
    found = Calibration.of_camera(CAMERA.disturbed(np.array([0, 0, 0, 0.1, 0.0])))
    refused = replace(found, status="undetermined", camera=None, reason="too few people")
    answers = [refused, found]

    def solved(spell, options, progress):
        frames = [*spell.frames(range(options.frames))]
        return Run(answers.pop(0), spell.name, frames[-1].image_bgr)

    def written(result, folder, *, progress):
        folder.mkdir(parents=True)
        result.calibration.save(folder / "camera.json")
        cv2.imwrite(str(folder / "background.jpg"), result.image_bgr)

    monkeypatch.setattr("scene4d.tracking._recalibrating._FRAMES", 4)
    monkeypatch.setattr("scene4d.tracking._recalibrating.run_footage", solved)
    monkeypatch.setattr("scene4d.tracking._recalibrating.write", written)
    detector()
    states, save = [], Status.save
    monkeypatch.setattr(
        Status, "save", lambda one, at: (states.append((one.camera, one.state)), save(one, at))
    )
    run = scripted([0] * 10 + [24] * 60 + [0] * 40, recalibrate=True)
    assert [one for one, _ in groupby(states)] == [
        *(("y", state) for state in ("live", "moved", "calibrating", "refused", "ended")),
        *(("y-2", state) for state in ("live", "moved", "calibrating", "ended")),
        *(("y", state) for state in ("live", "ended")),
    ]
    assert run.cameras == ["y", "y-2", "y"]
    assert "cannot be calibrated: too few people" in caplog.text
    scene = Scene.open(tmp_path / "scene")
    assert [one.camera for one in scene.runs] == ["y", "y-2", "y"]
    assert len(scene) == run.rows == sum(one.rows for one in scene.runs)
    spans = [one.span_s for one in scene.runs]
    assert spans[0][1] < 8 < 15 < spans[1][0] < 35 < spans[1][1] < 38 < spans[2][0] < 50
    heights = [read_camera(scene.camera_file(name)).height_m for name in ("y", "y-2")]
    assert heights == pytest.approx([5.0, 5.0 * np.exp(0.1)])


def test_annotations_and_pictures_cannot_be_watched(tmp_path, camera):
    with pytest.raises(InputError, match="annotations: cannot be watched"):
        video = write_video(tmp_path / "yard.avi", seconds=1)
        watch(video, camera, tmp_path / "s", tracking=TrackOptions(annotations="boxes.txt"))
    cv2.imwrite(str(tmp_path / "one.png"), ground())
    with pytest.raises(InputError, match="cannot be played at real time"):
        watch(tmp_path / "one.png", camera, tmp_path / "s")


ALONE = """
import sys, pytest
sys.path[:0] = sys.argv[1:3]
from conftest import Perfect, play_endless
import scene4d.perception.objects as objects, scene4d.calibration.watching as watching
objects.ObjectDetector.default = lambda **_: Perfect()
watching.fetch_weights = lambda *_, **__: None
from scene4d.tracking.live import watch
from scene4d.video.live import LiveSource
LiveSource._play = play_endless
look = Perfect.look
def telling(self, frame):
    print(frame.time_s, flush=True)
    sys.stdin.readline()
    return look(self, frame)
Perfect.look = telling
watch(*sys.argv[3:])
"""


def test_what_was_published_outlives_kill_9(tmp_path):
    camera, scene = tmp_path / "camera.json", tmp_path / "scene"
    CAMERA.save(camera)
    video = write_video(tmp_path / "yard.avi", seconds=1)
    places = map(str, (HERE / "tracking", HERE, video, camera, scene))
    looked: list[float] = []
    with subprocess.Popen(
        [sys.executable, "-c", ALONE, *places],
        cwd=HERE, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as alone:  # fmt: skip
        while len({int(time_s) for time_s in looked}) < 4:
            looked.append(float(alone.stdout.readline()))
            alone.stdin.write("go on\n")
            alone.stdin.flush()
        alone.kill()
    found = Scene.open(scene)
    (run,) = found.runs
    assert len(found.tracks()) == run.rows > 0
    before = [time_s for time_s in looked if int(time_s) < int(looked[-1])]
    assert run.span_s[1] >= before[-1] - 1e-6, "all seconds before the last one"


class Walkers:
    """Two people and a parked car; the first person is gone after three seconds. At half a second
    ``meanwhile`` is called.
    """

    def __init__(self, perfect):
        self._perfect, self.timings = perfect, perfect.timings
        self.meanwhile = lambda: None

    def expecting(self, _):
        return self

    def attentive(self):
        return self

    def begin(self):
        self._perfect.begin()

    def look(self, frame):
        if frame.time_s >= 0.5:
            self.meanwhile()
            self.meanwhile = lambda: None
        found, colours, readings = self._perfect.look(frame)
        rows = np.arange(len(found)) if frame.time_s < 3 else np.arange(1, len(found))
        return found.select(rows), colours[rows], readings[rows]


class Hook(BaseHTTPRequestHandler):
    """Takes alerts, but not the first time."""

    taken: ClassVar[list[dict]] = []
    came = threading.Event()
    refused = 0

    def do_POST(self):
        content = self.rfile.read(int(self.headers["Content-Length"]))
        if Hook.refused == 0:
            Hook.refused = 1
            self.send_error(503)
            return
        Hook.taken.append(json.loads(content))
        self.send_response(204)
        self.end_headers()
        Hook.came.set()

    def log_message(self, *_):
        """Nothing."""


@pytest.fixture
def hook():
    Hook.taken, Hook.refused, Hook.came = [], 0, threading.Event()
    with ThreadingHTTPServer(("127.0.0.1", 0), Hook) as served:
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{served.server_address[1]}/alerts"
        served.shutdown()


@pytest.fixture
def walkers(detector, monkeypatch):
    made = Walkers(detector())
    monkeypatch.setattr(ObjectDetector, "default", lambda **_: made)
    return made


def test_an_event_is_told_soon_once_and_sent_with_a_picture(
    tmp_path, camera, hook, walkers, caplog, paced, monkeypatch
):
    """The webhook refuses at first, and one more alert goes to a command. What is searched for was
    kept in the scene while the camera was running, beside searches that are not of this camera.
    """
    told: list[dict] = []
    scene = tmp_path / "scene"

    def keep():
        there = {"points": [[-30, 0], [30, 0], [30, 60], [-30, 60]]}
        zones = {"here": there | {"camera": "yard"}, "there": there | {"camera": "gate"}}
        (scene / "zones.json").write_text(json.dumps({"zones": zones}))
        for words in ("person disappears", "person in zone there"):
            keep_search(scene, words, ("yard", "gate"))
        kept = json.loads((scene / "standing.json").read_text())
        kept["searches"] += ["colourless green ideas"]
        (scene / "standing.json").write_text(json.dumps(kept))

    # Under load less is searched; here each second is.
    monkeypatch.setattr("scene4d.tracking._live_events._SHARE", float("inf"))
    keep_search(tmp_path, "person moves", ())  # whoever keeps a search elsewhere takes no time here
    walkers.meanwhile = keep
    script = tmp_path / "took.py"
    script.write_text(
        f"import sys; open({str(tmp_path / 'took.json')!r}, 'a').write(sys.stdin.read())"
    )
    run = watch(
        write_video(tmp_path / "yard.avi", seconds=6),
        camera,
        tmp_path / "scene",
        min_score=0.2,
        alerts=[hook, f"exec:{sys.executable} {script}"],
        tell=lambda event: told.append(event) or Hook.came.wait(60),
    )
    first = [event for event in told if event["state"] == "provisional"]
    assert len(first) == run.events == 1
    assert first[0]["end_s"] == pytest.approx(3, abs=1)
    assert [event["state"] for event in told] == ["provisional", "final"]
    assert len({event["id"] for event in told}) == 1
    (alert,) = Hook.taken
    assert run.alerts_sent == 2
    assert alert["id"] == first[0]["id"]
    picture = cv2.imdecode(
        np.frombuffer(base64.b64decode(alert["thumbnail_jpeg"]), np.uint8), cv2.IMREAD_COLOR
    )
    assert picture.shape == (480, 640, 3)
    assert json.loads((tmp_path / "took.json").read_text())["id"] == alert["id"]
    (kept,) = (tmp_path / "scene" / "events").glob("*.jsonl")
    assert [json.loads(line) for line in kept.read_text().splitlines()] == told
    assert not list((tmp_path / "scene" / "alerts").rglob("*.json"))
    scene = Scene.open(tmp_path / "scene")
    assert alert["roles"]["person"] in scene.tracks().track
    assert "'colourless green ideas' is not searched for" in caplog.text
