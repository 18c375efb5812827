"""The server: what it answers, what it refuses, and its page in a real browser."""

import http.client
import io
import json
import os
import shutil
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from playwright.sync_api import expect

from app.pages import click, picture_at
from app.serving_tests import Running
from finding_scenes import people, write_scene
from scene4d.app import ServeOptions
from scene4d.app._served import Served
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.searching.kept import kept_searches
from scene4d.store.identities import Identities
from scene4d.store.site_file import SiteFile
from scene4d.store.site_writing import write_site
from scene4d.store.writing import SceneWriter
from scene4d.video.reader import open_source
from site_worlds import Eye, place, seen, store, strolls
from walks import CAMERA, FPS, SIZE, write_video


@pytest.fixture(scope="module")
def reading(scene: Path) -> Iterator[Running]:
    """Of a scene that nobody changes."""
    one = Running(scene)
    yield one
    one.close()


@pytest.fixture
def running(scene: Path, tmp_path: Path) -> Iterator[Running]:
    folder = shutil.copytree(scene, tmp_path / "scene")
    one = Running(folder)
    yield one
    one.close()


def test_programs_are_told_what_there_is_and_search(reading):
    status, headers, body = reading.ask("GET", "/openapi.json")
    assert status == 200
    described = json.loads(body)["paths"]
    assert {"/api/search", "/api/runs/{run}/video"} <= set(described)
    for path, methods in described.items():
        if "get" in methods and path != "/api/live":
            absent = path in ("/api/fused", "/api/runs/{run}/now")  # no site, and not watched
            expected = 404 if absent else 200
            path = path.replace("{run}/pieces/{piece}", "0/pieces").replace("{run}", "0")
            assert reading.ask("GET", path)[0] == expected, path
    assert headers["x-content-type-options"] == "nosniff"
    status, said = reading.post("/api/search", {"words": "two people meet", "top": 3})
    assert status == 200
    (found,) = said["searches"]
    assert found["events"][0]["roles"]
    assert found["understood"]
    for form, begin in (("json", '{\n "schema": "scene4d/search/1"'), ("csv", "activity,score,")):
        sent = json.dumps({"words": "two people meet", "format": form})
        status, _, body = reading.ask("POST", "/api/export", sent, Content_Type="application/json")
        assert status == 200 and body.decode().startswith(begin)
    assert reading.post("/api/export", {"words": "two people meet", "format": "exe"})[0] == 400
    status, said = reading.post("/api/search", {"words": "colourless green ideas"})
    assert status == 400
    assert said["error"]["kind"] == "input"


def test_a_search_that_takes_too_long_or_is_left_is_ended_and_frees_its_turn(reading, monkeypatch):
    meet = {"words": "two people meet"}
    assert reading.post("/api/search", meet)[0] == 200
    process = reading.api.searcher.process
    os.kill(process.pid, signal.SIGSTOP)  # a search that never ends
    monkeypatch.setattr("scene4d.app._api._SEARCH_S", 0.3)
    status, said = reading.post("/api/search", meet)
    assert (status, said["error"]["kind"]) == (503, "slow")
    assert process.returncode == -signal.SIGKILL
    monkeypatch.undo()
    client = http.client.HTTPConnection("127.0.0.1", reading.port)
    client.request("POST", "/api/search", json.dumps(meet), {"Content-Type": "application/json"})
    while (process := reading.api.searcher.process) is None:
        time.sleep(0.01)
    client.close()
    assert reading.post("/api/search", meet)[0] == 200
    assert process.returncode == -signal.SIGKILL


def test_footage_comes_in_ranges(reading):
    whole = reading.ask("GET", "/api/runs/0/video")[2]
    status, headers, part = reading.ask("GET", "/api/runs/0/video", Range="bytes=100-199")
    assert (status, part) == (206, whole[100:200])
    assert headers["content-type"] == "video/mp4"


@pytest.fixture(scope="module", params=["mpeg4.avi", "libx264.mkv", "libx264.avi"])
def in_pieces(request, tmp_path_factory) -> Iterator[tuple[Running, Path]]:
    """Of footage that browsers do not play as it is: 14 s that grow brighter by the second."""
    codec, _, kind = request.param.partition(".")
    folder = tmp_path_factory.mktemp("pieces")
    with av.open(str(folder / f"gate.{kind}"), "w") as container:
        stream = container.add_stream(codec, rate=FPS)
        stream.width, stream.height = SIZE
        stream.pix_fmt, stream.gop_size = "yuv420p", 15
        stream.max_b_frames = 2 if kind == "mkv" else 0
        for number in range(14 * FPS):
            grey = np.full((SIZE[1], SIZE[0], 3), 40 + 10 * (number // FPS), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")))
        container.mux(stream.encode(None))
    made = {"source": str(folder / f"gate.{kind}"), "rate_hz": 10}
    one = Running(write_scene(folder / "scene", people(), provenance=made))
    yield one, folder / f"gate.{kind}"
    one.close()


def test_footage_in_pieces_holds_every_frame_at_its_time(in_pieces):
    running, path = in_pieces
    assert running.ask("GET", "/api/runs/0/video")[0] == 404
    about = json.loads(running.ask("GET", "/api/runs/0/pieces")[2])
    assert 3 <= len(about["starts_s"]) <= 4
    assert running.ask("GET", f"/api/runs/0/pieces/{len(about['starts_s'])}")[0] == 404
    seen = {}
    for number in reversed(range(len(about["starts_s"]))):
        status, headers, mp4 = running.ask("GET", f"/api/runs/0/pieces/{number}")
        assert status == 200
        with av.open(io.BytesIO(mp4)) as container:
            for frame in container.decode(video=0):
                time_s = frame.pts * frame.time_base + float(headers["x-offset-s"])
                seen[round(time_s * FPS)] = (time_s, frame.to_ndarray(format="gray").mean())
    with open_source(path) as source:
        expected = {one.index: (one.time_s, one.image_bgr.mean()) for one in source.frames()}
    assert seen.keys() == expected.keys()
    for index, (time_s, grey) in expected.items():
        assert seen[index] == (pytest.approx(time_s, abs=2e-3), pytest.approx(grey, abs=4))


@pytest.mark.parametrize("in_pieces", ["libx264.mkv"], indirect=True)
def test_what_is_made_of_footage_is_bounded(in_pieces, monkeypatch):
    running, _ = in_pieces
    monkeypatch.setattr("scene4d.app._pieces._MOST_BYTES", 1)
    assert [running.ask("GET", f"/api/runs/0/pieces/{k}")[0] for k in (0, 1)] == [200, 200]
    assert not running.served._pieces._made


@pytest.mark.parametrize("in_pieces", ["mpeg4.avi", "libx264.mkv"], indirect=True)
def test_the_page_shows_pieces_where_it_is_looked(opened, in_pieces):
    page = opened.page
    page.goto(f"{in_pieces[0].url}/")
    expect(page.locator("#tracks-count")).to_have_text("4 of 4 tracks")
    x, y = picture_at(page, 600, 20)
    box = page.locator("#picture").bounding_box()
    ratio = page.evaluate("devicePixelRatio")
    pixel = [ratio * (x - box["x"]), ratio * (y - box["y"])]
    line = page.locator("#timeline").bounding_box()
    for share in (0.4, 0.1, 0.3):
        page.mouse.click(line["x"] + share * line["width"], line["y"] + line["height"] / 2)
        second = int(float(page.locator("#timeline").get_attribute("aria-valuenow")))
        page.wait_for_function(
            """([pixel, least, most]) => {
              const canvas = document.getElementById("picture");
              const one = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
              one.drawImage(canvas, -pixel[0], -pixel[1]);
              const grey = one.getImageData(0, 0, 1, 1).data[1];
              return least < grey && grey < most;
            }""",
            arg=[pixel, 40 + 10 * second - 16, 40 + 10 * second + 16],
        )


def test_what_is_asked_from_elsewhere_is_refused(reading):
    asked = (
        (421, {"Host": "evil.example"}),
        (421, {"Host": "127.0.0.1.evil.example:80"}),
        (403, {"Origin": "https://evil.example"}),
        (403, {"Sec_Fetch_Site": "cross-site"}),
        (400, {"Content_Length": "-1"}),
    )
    for status, headers in asked:
        assert reading.ask("GET", "/api/scene", **headers)[0] == status, headers
    status, _, body = reading.ask("POST", "/api/search", '{"words": "x"}')
    assert (status, b"application/json" in body) == (400, True)  # no form of another page
    long = json.dumps({"words": "x" * 1_100_000})
    assert reading.post("/api/search", {"words": "x" * 1000})[0] == 400
    assert reading.ask("POST", "/api/search", long, Content_Type="application/json")[0] == 413
    assert (
        reading.post("/api/search", {"words": "two people meet", "zones": "/etc/passwd"})[0] == 400
    )


@pytest.mark.parametrize(
    "path",
    [
        "/api/runs/9/rows",
        "/api/runs/-1/rows",
        "/api/runs/..%2f..%2fcameras/video",
        "/../../../etc/passwd",
        "/scene/cameras/gate.json",
        "/api/runs/0/rows/../../../etc/passwd",
        "/api/runs/0/pieces/..%2f..%2f0",
        "/api/runs/0/pieces/-1",
        "/api/runs/0/calibration/../../zones.json",
        "/standing.json",
    ],
)
def test_no_file_but_the_given_runs_is_served(reading, path):
    assert reading.ask("GET", path)[0] == 404


def test_hostile_names_of_cameras_stay_inside_the_scene(tmp_path):
    video = write_video(tmp_path / "x.mp4", seconds=1)
    made = {"source": str(video), "annotations": "../../boxes.txt"}
    folder = write_scene(tmp_path / "s", people(), camera="../../<b>", provenance=made)
    served = Served([folder], None, None)
    out = Path(served.to_calibrate(0, {})[0]["out"])
    served.close()
    assert out.parent == folder / "judged"
    assert out.resolve().is_relative_to(folder.resolve())


def test_zones_are_checked_and_kept(running, tmp_path):
    bay = {"zones": {"bay": {"camera": "gate", "points": [[0, 9], [3, 9], [3, 12]]}}}
    assert running.post("/api/places", bay, "PUT") == (200, {"saved": True})
    assert json.loads(running.ask("GET", "/api/places")[2]) == bay
    for bad in (
        {"zones": {"x": {"points": [[0, 0], [1, 1], [1, 0], [0, 1]]}}},
        {"zones": {"x": {"camera": "nowhere", "points": [[0, 9], [3, 9], [3, 12]]}}},
        {"zones": [1]},
    ):
        status, said = running.post("/api/places", bad, "PUT")
        assert (status, said["error"]["kind"]) == (400, "input")
        assert str(tmp_path) not in said["error"]["message"]
    assert json.loads(running.ask("GET", "/api/places")[2]) == bay
    assert running.post("/api/places", {}, "PUT")[0] == 200
    assert json.loads(running.ask("GET", "/api/places")[2]) == {}


def test_searches_are_kept_for_those_who_watch(running):
    (folder,) = running.served._folders
    kept = {"searches": ["two people meet"]}
    for _ in range(2):
        assert running.post("/api/alerts", {"words": "two people meet"}, "PUT") == (200, kept)
    assert kept_searches(folder) == ("two people meet",)
    for words in ("colourless green ideas", "person in zone nowhere", "", "x" * 401, 7):
        assert running.post("/api/alerts", {"words": words}, "PUT")[0] == 400, words
    assert json.loads(running.ask("GET", "/api/alerts")[2]) == kept
    nothing = {"searches": []}
    assert running.post("/api/alerts", {"words": "two people meet"}, "DELETE") == (200, nothing)
    bad = (
        [1],
        {"schema": "other"},
        {"schema": "scene4d/standing/1", "searches": [1]},
        {"schema": "scene4d/standing/1", "searches": ["a"] * 33},
        {"schema": "scene4d/standing/1", "searches": [], "targets": ["exec:rm"]},
    )
    for said in bad:
        (folder / "standing.json").write_text(json.dumps(said))
        with pytest.raises(InputError, match=r"standing.json"):
            kept_searches(folder)
    assert running.post("/api/alerts", {"words": "two people meet"}, "PUT")[0] == 400


def test_others_need_the_token(scene):
    with pytest.raises(InputError, match="a token is needed"):
        ServeOptions(host="0.0.0.0")
    one = Running(scene, host="0.0.0.0", token="correct horse", public_names=["gate.example"])
    try:
        assert one.ask("GET", "/api/scene")[0] == 401
        assert one.ask("GET", "/")[0] == 401
        assert one.ask("GET", "/api/scene", Authorization="Bearer wrong horse")[0] == 401
        assert one.ask("GET", "/api/scene?token=correct%20horse")[0] == 401
        bearer = {"Authorization": "Bearer correct horse"}
        assert one.ask("GET", "/api/scene", **bearer)[0] == 200
        for host, expected in (("evil.example", 421), ("10.1.2.3", 421), ("Gate.example:443", 200)):
            assert one.ask("GET", "/api/scene", Host=host, **bearer)[0] == expected, host
        foreign = {"Host": "gate.example", "Origin": "https://evil.example"}
        assert one.ask("GET", "/api/scene", **foreign, **bearer)[0] == 403
        status, headers, _ = one.ask("GET", "/?token=correct%20horse")
        assert (status, headers["location"]) == (303, "/")
        assert "HttpOnly" in headers["set-cookie"]
        cookie = headers["set-cookie"].partition(";")[0]
        assert one.ask("GET", "/api/scene", Cookie=cookie)[0] == 200
    finally:
        one.close()


def test_the_served_page_searches_in_a_drawn_zone(opened, running):
    page = opened.page
    page.goto(f"{running.url}/")
    expect(page.locator("#live")).to_have_attribute("data-state", "connected")
    expect(page.locator("#tracks-count")).to_have_text("5 of 5 tracks")
    page.keyboard.press("z")
    corners = [[-1.5, 14.0, 0], [2.5, 14.0, 0], [2.5, 18.5, 0], [-1.5, 18.5, 0]]
    for corner in CAMERA.project(corners)[0]:
        click(page, *corner)
    page.keyboard.press("Enter")
    page.locator("#place-name").fill("bay")
    with page.expect_response("**/api/places"):
        page.keyboard.press("Enter")
    page.locator("#tab-events").click()
    page.locator("#words").fill("a person enters the zone bay")
    page.keyboard.press("Enter")
    expect(page.locator(".event")).to_have_count(1)
    page.locator(".event").click()
    assert page.locator("#timeline").get_attribute("aria-valuetext").startswith("00:07.")
    with page.expect_download() as saving:
        page.get_by_label("Save ActEV").click()
    assert json.loads(Path(saving.value.path()).read_text())["filesProcessed"] == ["gate.mp4"]
    with page.expect_response("**/api/alerts"):
        page.get_by_text("Tell me when it happens").click()
    expect(page.locator("#alerts-list")).to_contain_text("a person enters the zone bay")
    assert {url.partition("/api")[0].rstrip("/") for url in opened.asked} <= {running.url, "data:,"}


def test_whoever_asks_is_answered_from_the_newest_manifests(request, tmp_path, monkeypatch):
    """Also who listens to nothing: a stream soon removes the parts that it has replaced. A folder
    that is still empty is served; one that holds something else is refused.
    """
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").touch()
    for name in ("other", "none"):
        with pytest.raises(InputError, match="holds no scene"):
            Served([tmp_path / name], None, None)
    monkeypatch.setattr("scene4d.store.writing._KEPT_S", -1.0)
    scene, rows = tmp_path / "scene", people()
    scene.mkdir()
    request.addfinalizer((one := Running(scene)).close)
    moments = [tracks.select(tracks.time_s < 9) for tracks in rows]
    calibration = Calibration.of_camera(CAMERA).to_dict()

    def runs() -> list:
        status, _, body = one.ask("GET", "/api/scene")
        assert status == 200
        return json.loads(body)["runs"]

    assert runs() == []
    status, said = one.post("/api/search", {"words": "two people meet"})
    assert (status, "nobody was tracked" in said["error"]["message"]) == (400, True)
    with SceneWriter(
        scene, camera="gate", run="r", start_utc=None, camera_json=calibration, provenance={},
        live=True,
    ) as out:  # fmt: skip
        for number, tracks in enumerate([*moments, *rows]):
            out.write(replace(tracks, track=tracks.track + 10 * number))
            out.commit(replace(moments[0], track=moments[0].track + 500))
            (run,) = runs()
            assert run["rows"] == out.run.rows
            status, _, body = one.ask("GET", "/api/runs/0/rows")
            assert (status, json.loads(body)["rows"]) == (200, out.run.rows)
        assert one.post("/api/search", {"words": "two people meet"})[0] == 200


def test_a_scene_of_a_site_that_is_tracked_again_is_noticed(request, tmp_path):
    eyes = [Eye(name, place(0.0, 0.0, 0.0), (0.0, 0.0), 20.0) for name in ("west", "east")]
    (before, whose), (after, _) = (seen(eyes[0], strolls(n, 40.0, 6.0)) for n in (3, 5))
    cameras = {eye.name: store(tmp_path / eye.name, eye, before, None) for eye in eyes}
    rows = [(eye.name, number, who, 1.0) for eye in eyes for number, who in whose.items()]
    identities = Identities(*(np.array(column) for column in zip(*rows, strict=True)))
    write_site(tmp_path / "site", SiteFile(cameras), identities, refined={}, pictures={})
    request.addfinalizer((one := Running(tmp_path / "site")).close)
    with one.listening() as news:
        first = [next(news) for _ in eyes]  # both, though their runs have one name
        assert [(kind, said["camera"]) for kind, said in first] == [
            ("run", "west"),
            ("run", "east"),
        ]
        cameras["west"] = store(tmp_path / "west", eyes[0], after, None)
        status, _, body = one.ask("GET", "/api/scene")  # identities name the tracks of before
        assert (status, b"tracked again" in body and b"align again" in body) == (400, True)
        write_site(tmp_path / "site", SiteFile(cameras), identities, refined={}, pictures={})
        said = next(said for kind, said in news if kind == "run")
    assert (said["camera"], said["rows"]) == ("west", len(after))
    rows = json.loads(one.ask("GET", f"/api/runs/{said['number']}/rows")[2])
    assert rows["rows"] == np.isin(after.track, list(whose)).sum()


def test_who_comes_back_is_told_what_was_missed(request, opened, running):
    """A run that came and ended meanwhile, and then one that was tracked again, which the next
    server counts otherwise.
    """
    (folder,) = running.served._folders
    page = opened.page
    page.goto(f"{running.url}/")
    expect(page.locator("#tracks-count")).to_have_text("5 of 5 tracks")
    running.close()
    expect(page.locator("#live")).to_have_attribute("data-state", "lost")
    write_scene(folder, people()[:2], run="earlier", provenance={"rate_hz": 10})
    again = Running(folder, at_port=running.port)
    request.addfinalizer(again.close)
    expect(page.locator("#run-choice option")).to_have_count(2)
    write_scene(folder, people()[:3], provenance={"rate_hz": 10})
    expect(page.locator("#tracks-count")).to_have_text("3 of 3 tracks")
    page.goto("about:blank")  # else it tries again, and complains that nobody answers
    opened.complaints.clear()
