"""Alerts: delivered once, later if need be, after a restart too, and never in the way."""

import json
import shutil
import socket
import socketserver
import subprocess
import sys
import threading
import time
from types import SimpleNamespace
from typing import ClassVar

import pytest

from scene4d.core.errors import InputError
from scene4d.tracking import _alerts as alerts
from scene4d.tracking._alert_targets import target_of
from scene4d.tracking._alerts import Alerts

EVENT = {"id": "a1", "search": "person enters vehicle", "score": 0.8}


def waiting(scene):
    return [json.loads(path.read_text())["id"] for path in sorted(scene.rglob("*.json"))]


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    monkeypatch.setattr(alerts, "_FIRST_WAIT_S", 0.05)
    monkeypatch.setattr(alerts, "_LAST_S", 3.0)


def sink(path, *, fails: int = 0) -> str:
    """A command that appends what it reads to a file, after some failures."""
    said = (
        "import pathlib, sys\n"
        f"p, tries = pathlib.Path({str(path)!r}), pathlib.Path({str(path) + '.tries'!r})\n"
        "n = len(tries.read_text()) if tries.exists() else 0\n"
        "tries.write_text('x' * (n + 1))\n"
        f"if n < {fails}: sys.exit(3)\n"
        "p.open('a').write(sys.stdin.read() + '\\n')\n"
    )
    script = path.with_suffix(".py")
    script.write_text(said)
    return f"exec:{sys.executable} {script}"


def taken(path):
    return [json.loads(line)["id"] for line in path.read_text().splitlines()]


def test_what_cannot_be_delivered_waits_in_the_scene_and_goes_out_after_a_restart(tmp_path):
    scene, file = tmp_path / "scene", tmp_path / "took.txt"
    target = sink(file, fails=9)
    with Alerts([target], scene, "gate") as first:
        begun_s = time.monotonic()
        for name in ("a1", "a2"):
            first.put(EVENT | {"id": name})
        assert time.monotonic() - begun_s < 1, "nobody waits for a delivery"
    assert first.sent == 0
    assert waiting(scene) == ["a1", "a2"]
    assert "2 alerts wait in the scene" in first.warnings[0]
    (tmp_path / "took.txt.tries").write_text("x" * 9)
    with Alerts([target], scene, "gate") as second:
        second.put(EVENT | {"id": "a3"})
    assert taken(file) == ["a1", "a2", "a3"]
    assert waiting(scene) == [] and not second.warnings
    with Alerts([target], scene, "gate"):
        pass
    assert taken(file) == ["a1", "a2", "a3"], "each is sent once"


def test_alerts_stay_apart_and_in_order_whatever_the_clock_does(tmp_path, monkeypatch):
    """It stands still, and after a restart it is an hour back. One that somebody takes away holds
    up no other.
    """
    scene, clock, heard, there = tmp_path / "scene", [10**18], [], threading.Event()

    def send(content):
        if not there.is_set():
            raise ConnectionRefusedError
        heard.append(json.loads(content)["id"])

    target = SimpleNamespace(name="somebody", send=send, close=lambda: None)
    monkeypatch.setattr(alerts, "target_of", lambda said: target)
    monkeypatch.setattr(time, "time_ns", lambda: clock[0])
    with Alerts(["somebody"], scene, "gate") as first:
        for number in range(4):
            first.put(EVENT | {"id": f"a{number}"})
    clock[0] -= 3600 * 10**9
    with Alerts(["somebody"], scene, "gate") as second:
        second.put(EVENT | {"id": "a4"})
        assert waiting(scene) == ["a0", "a1", "a2", "a3", "a4"]
        sorted(scene.rglob("*.json"))[1].unlink()
        there.set()
    assert heard == ["a0", "a2", "a3", "a4"]
    assert waiting(scene) == [] and not second.warnings


def test_it_is_tried_again_and_told_once(tmp_path, caplog):
    file = tmp_path / "took.txt"
    with Alerts([sink(file, fails=2)], tmp_path / "scene", "gate") as out:
        out.put(EVENT)
        until_s = time.monotonic() + 20
        while not out.sent and time.monotonic() < until_s:
            time.sleep(0.02)
    assert taken(file) == ["a1"]
    told = [text for text in caplog.messages if "deliver" in text]
    assert ["cannot" in text for text in told] == [True, False]


def test_too_many_that_wait_are_dropped_and_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(alerts, "_MOST_WAITING", 3)
    with Alerts([sink(tmp_path / "took.txt", fails=99)], tmp_path / "scene", "gate") as out:
        for number in range(5):
            out.put(EVENT | {"id": f"a{number}"})
    assert waiting(tmp_path / "scene") == ["a2", "a3", "a4"]
    assert "2 alerts were dropped" in out.warnings[0]


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("ftp://me:secret@host/x", "expected https://"),
        ("https://", "expected an address with a host"),
        ("http://host:99999/x", "expected an address with a host"),
        ("exec:", "there is no command"),
        ("exec:no-such-command --now", "there is no command 'no-such-command'"),
        ("exec:'open", "No closing quotation"),
        ("mqtt://broker", "expected mqtt://host/topic"),
        ("mqtt://broker/gate/#", "expected mqtt://host/topic"),
    ],
)
def test_impossible_targets_are_refused(said, message):
    if said.startswith("mqtt"):
        pytest.importorskip("paho.mqtt")
    with pytest.raises(InputError, match=message) as refused:
        target_of(said)
    assert "secret" not in str(refused.value)


class SmallBroker(socketserver.BaseRequestHandler):
    """As much of MQTT 3.1.1 as one publisher needs, where mosquitto is not installed."""

    published: ClassVar[list[bytes]] = []

    def handle(self):
        while (head := self.request.recv(1)) and (body := self._body()) is not None:
            kind = head[0] >> 4
            if kind == 1:
                self.request.sendall(b"\x20\x02\x00\x00")
            elif kind == 3:
                topic = 2 + int.from_bytes(body[:2])
                self.published.append(body[topic + 2 :])
                self.request.sendall(b"\x40\x02" + body[topic : topic + 2])
            elif kind == 12:
                self.request.sendall(b"\xd0\x00")

    def _body(self):
        length = shift = 0
        while True:
            byte = self.request.recv(1)
            if not byte:
                return None
            length, shift = length | (byte[0] & 127) << shift, shift + 7
            if byte[0] < 128:
                break
        body = b""
        while len(body) < length:
            body += self.request.recv(length - len(body))
        return body


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def broker():
    """Its port, and the list of what arrives at topic gate: mosquitto, where there is one."""
    client = pytest.importorskip("paho.mqtt.client", reason="needs paho-mqtt (group dev)")
    found = shutil.which("mosquitto", path="/usr/bin:/usr/sbin:/usr/local/sbin:/usr/local/bin")
    if found is None:
        SmallBroker.published = []
        with socketserver.ThreadingTCPServer(("127.0.0.1", 0), SmallBroker) as served:
            threading.Thread(target=served.serve_forever, daemon=True).start()
            yield served.server_address[1], SmallBroker.published
            served.shutdown()
        return
    port, arrived = free_port(), []
    with subprocess.Popen([found, "-p", str(port)], stderr=subprocess.DEVNULL) as running:
        listener = client.Client(client.CallbackAPIVersion.VERSION2)
        listener.on_connect = lambda one, *_: one.subscribe("gate", qos=1)
        listener.on_message = lambda _, __, message: arrived.append(message.payload)
        ready = threading.Event()
        listener.on_subscribe = lambda *_: ready.set()
        listener.connect_async("127.0.0.1", port)
        listener.reconnect_delay_set(min_delay=1, max_delay=1)
        listener.loop_start()
        assert ready.wait(10)
        yield port, arrived
        listener.disconnect()
        listener.loop_stop()
        running.terminate()


def test_alerts_arrive_at_an_mqtt_broker(tmp_path, broker):
    port, arrived = broker
    with Alerts([f"mqtt://127.0.0.1:{port}/gate"], tmp_path / "scene", "gate") as out:
        for number in range(3):
            out.put(EVENT | {"id": f"a{number}"})
    until_s = time.monotonic() + 5
    while len(arrived) < 3 and time.monotonic() < until_s:
        time.sleep(0.02)
    assert [json.loads(content)["id"] for content in arrived] == ["a0", "a1", "a2"]
    assert out.sent == 3
    assert waiting(tmp_path / "scene") == []


def test_a_broker_that_is_not_there_holds_nobody_up(tmp_path):
    pytest.importorskip("paho.mqtt", reason="needs paho-mqtt (group dev)")
    begun_s = time.monotonic()
    with Alerts([f"mqtt://127.0.0.1:{free_port()}/gate"], tmp_path / "s", "gate") as out:
        out.put(EVENT)
    assert time.monotonic() - begun_s < 4
    assert waiting(tmp_path / "s") == ["a1"]
