"""Streams that state a length: which are running cameras, and which are recordings?"""

import threading
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import av
import numpy as np
import pytest

from scene4d.video.live import LiveSource

FRAMES = 50


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Two seconds of noise."""
    path = tmp_path_factory.mktemp("clip") / "clip.avi"
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mjpeg", rate=25)
        stream.width = stream.height = 64
        stream.pix_fmt = "yuvj420p"
        for _ in range(FRAMES):
            image = rng.integers(0, 255, (64, 64, 3), dtype=np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        out.mux(stream.encode(None))
    return path.read_bytes()


@contextmanager
def served(content: bytes, *, length: int | None):
    """An address that sends this to each of two visitors, and perhaps says how long it is."""
    visits = []

    class Camera(BaseHTTPRequestHandler):
        def do_GET(self):
            visits.append(self.path)
            if len(visits) > 2:
                self.send_error(503)
                return
            self.send_response(200)
            if length is not None:
                self.send_header("Content-Length", str(length))
            self.end_headers()
            with suppress(OSError):
                self.wfile.write(content)

        def log_message(self, *_):
            """Nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Camera) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/clip.avi"
        server.shutdown()


@pytest.fixture(autouse=True)
def _at_once(monkeypatch):
    """What is sent is there at once, and what is lost is asked for again at once."""
    monkeypatch.setattr("scene4d.video.live._AHEAD_S", 60.0)
    monkeypatch.setattr("scene4d.video.live._FIRST_WAIT_S", 0.01)


def watched(url):
    """The source at its end, and the times of its frames."""
    with LiveSource(url, 25.0, give_up_s=0.0) as source:
        times = [frame.time_s for frame in source.frames()]
    return source, times


def test_a_camera_that_states_a_length_is_opened_again(clip):
    with served(clip[: len(clip) // 2], length=None) as url:
        source, times = watched(url)
    assert source.reconnected == 1
    assert 0.5 < max(times) < 3
    assert "the stream did not come back" in source.warnings[0]


def test_so_is_one_that_goes_on_after_its_stated_length(clip):
    """The header is of two seconds; four follow."""
    again = clip[clip.index(b"movi") + 4 : clip.index(b"idx1")]
    more = clip[: clip.index(b"idx1")] + 3 * again
    with served(more, length=None) as url:
        assert watched(url)[0].reconnected == 1


@pytest.mark.parametrize("says_its_size", [False, True])
def test_a_recording_that_was_played_is_over(clip, says_its_size):
    with served(clip, length=len(clip) if says_its_size else None) as url:
        source, times = watched(url)
    assert source.reconnected == 0
    assert source.offered == FRAMES
    assert max(times) == pytest.approx((FRAMES - 1) / 25)
    assert not [text for text in source.warnings if "dropped" not in text]


def test_a_recording_that_is_lost_is_not_begun_again(clip):
    with served(clip[: len(clip) // 2], length=len(clip)) as url:
        source, _ = watched(url)
    assert source.reconnected == 0
