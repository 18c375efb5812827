"""Every reader with a good file, and ways to spoil files: read or refused, nothing else may happen.

``tests/test_fuzz.py`` takes a few of each, ``scripts/fuzz.py`` as many as there is time for.
"""

import json
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

import fuzz_texts as texts
from scene4d.app._contents import told_event
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError, Scene4DError
from scene4d.core.landmarks import Landmarks
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections
from scene4d.core.tables import read_table, write_people
from scene4d.formats.activities import read_activities
from scene4d.formats.anchors import read_anchors
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.formats.homographies import read_ground_map, read_reference
from scene4d.formats.points import read_points
from scene4d.searching._places import read_places
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.store.identities import Identities
from scene4d.store.log import DetectionLog, Look
from scene4d.store.query import Scene
from scene4d.store.site import Site
from scene4d.store.site_file import SiteFile
from scene4d.store.site_writing import write_site
from scene4d.video.reader import open_source
from site_worlds import CAMERA, Eye, place, seen, store, strolls

Read = Callable[[Path], object]
TOKENS = [
    "", "-", "nan", "inf", "1e400", "1e308", "1e-308", "-1e200", "0", "²", "null", "[", "]", "{}",
    ",", "\n", "true", "'", "1.2.3", "9" * 400, "9" * 5000, "&a [", "*a", "<<: ", '"', "\x1b[31m",
    "utf-32", "idna", "hex", "\x00", "[[[[", "x" * 3000, "10000000000", "é", ": ", "3000000000",
]  # fmt: skip
VALUES: list[Any] = [
    None, True, 0, -1, 1e308, 10**400, float("nan"), float("inf"), "", "x" * 3000, "../../etc",
    "\x1b[31m", "\ud800", [], {}, [[]], [None], {"a": 1}, 2**63, -(2**63), 1e-320, "2026-11-20",
    [0] * 5000,
]  # fmt: skip


@dataclass(frozen=True)
class Sample:
    """``make`` writes good files below a folder and gives the one that is spoilt; ``read`` reads
    that, and whatever lies beside it.
    """

    make: Callable[[Path], Path]
    read: Read


def _text(file: str, text: str, read: Read) -> Sample:
    def make(folder: Path) -> Path:
        (folder / file).write_text(text, encoding="utf-8")
        return folder / file

    return Sample(make, read)


def _colmap(file: str) -> Sample:
    def make(folder: Path) -> Path:
        for name, text in texts.COLMAP.items():
            if (file, name) != ("images.txt", "frames.txt"):
                (folder / name).write_text(text)
        return folder / file

    return Sample(make, lambda path: read_camera(path.parent))


def _annotations(name: str, drop: bool) -> Sample:
    def make(folder: Path) -> Path:
        (folder / "clip.types.yml").write_text(texts.TYPES)
        (folder / "clip.geom.yml").write_text(texts.ANNOTATIONS[name])
        return folder / "clip.geom.yml"

    def read(path: Path) -> object:
        return read_annotations(path, format=name, image_size=(1920, 1080), drop_invalid=drop)

    return Sample(make, read)


def _types() -> Sample:
    def make(folder: Path) -> Path:
        return _annotations("kpf", False).make(folder).with_name("clip.types.yml")

    geom = "clip.geom.yml"
    return Sample(make, lambda p: read_annotations(p.with_name(geom), image_size=(1920, 1080)))


EYE = Eye("c", place(0.0, 0.0, 0.0), (0.0, 0.0), 12.0)


def _scene(folder: Path) -> Path:
    """A small scene whose parts have no checksum, as while a stream runs."""
    store(folder / "scene", EYE, seen(EYE, strolls(2, 40.0, 6.0))[0])
    manifest = folder / "scene" / "runs" / "r.json"
    said = json.loads(manifest.read_text())
    for part in said["parts"]:
        del part["sha256"]
    manifest.write_text(json.dumps(said))
    return folder / "scene"


def _read_scene(folder: Path) -> None:
    scene = Scene.open(folder)
    scene.tracks(classes=["person"])
    scene.tracks(begin=1.0, end=4.0)
    for camera in scene.cameras:
        Calibration.load(scene.camera_file(camera))


def _in_scene(pattern: str) -> Sample:
    def make(folder: Path) -> Path:
        (found,) = _scene(folder).glob(pattern)
        return found

    def read(path: Path) -> None:
        _read_scene(next(above for above in path.parents if above.name == "scene"))

    return Sample(make, read)


def _in_site(file: str) -> Sample:
    def make(folder: Path) -> Path:
        tracks, whose = seen(EYE, strolls(2, 40.0, 6.0))
        entry = store(folder / "scene", EYE, tracks)
        n = len(whose)
        names = np.array(["c"] * n), np.array([*whose]), np.arange(1, n + 1), np.ones(n)
        write_site(
            folder / "site", SiteFile({"c": entry}), Identities(*names), refined={}, pictures={}
        )
        return next((folder / "site").glob(file))

    def read(path: Path) -> None:
        site = Site.open(path.parent)
        site.tracks(begin=0.0, end=9.0)

    return Sample(make, read)


def _log(file: str) -> Sample:
    def make(folder: Path) -> Path:
        log = DetectionLog(folder / "log", {"detector": "d", "chunk": 4})
        boxes = np.array([[10.0, 20, 30, 60], [50, 20, 70, 80]])
        people = Detections.from_boxes((640, 480), np.array([0, 1]), boxes)
        log.append(Look(np.arange(4), np.arange(4) / 10, people, np.zeros((2, 3))))
        log.finish()
        return folder / "log" / file

    def read(path: Path) -> None:
        for _ in DetectionLog(path.parent, {"detector": "d", "chunk": 4}).chunks():
            pass

    return Sample(make, read)


def _table(folder: Path) -> Path:
    columns = {"u": np.arange(9.0), "name": np.array(["a"] * 9)}
    write_people(folder / "t.parquet", columns)
    return folder / "t.parquet"


def _picture(ending: str) -> Sample:
    def make(folder: Path) -> Path:
        grey = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
        (folder / f"a{ending}").write_bytes(cv2.imencode(ending, grey)[1].tobytes())
        return folder / f"a{ending}"

    return Sample(make, _look)


def _look(path: Path) -> None:
    with open_source(path) as source:
        for _ in source.frames(range(min(source.frame_count or 1, 9))):
            pass


def write_video(path: Path, codec: str, title: str = "") -> None:
    """Twelve small pictures of noise."""
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as file:
        file.metadata["title"] = title
        stream = file.add_stream(codec, rate=10)
        stream.width, stream.height, stream.pix_fmt = (
            64,
            48,
            "yuvj420p" if codec == "mjpeg" else "yuv420p",
        )
        for _ in range(12):
            picture = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        file.mux(stream.encode(None))


def _video(ending: str, codec: str) -> Sample:
    def make(folder: Path) -> Path:
        write_video(folder / f"a{ending}", codec)
        return folder / f"a{ending}"

    return Sample(make, _look)


def _event(folder: Path) -> Path:
    event = {"id": "1", "activity": "a", "state": "final", "run": "r", "roles": {}, "why": {}}
    (folder / "r.jsonl").write_text(
        json.dumps(event | dict.fromkeys(["begin_s", "end_s", "score"], 1.0))
    )
    return folder / "r.jsonl"


def _events(path: Path) -> None:
    for line in path.read_bytes().decode(errors="replace").splitlines():
        told_event(line)


def _calibration(folder: Path) -> Path:
    Calibration.of_camera(CAMERA).save(folder / "camera.json")
    return folder / "camera.json"


def _samples() -> Iterator[tuple[str, Sample]]:
    size = (640, 480)
    for name, text in texts.CAMERAS.items():
        yield (
            f"camera {name}",
            _text("camera", text, partial(read_camera, format=name, image_size=size)),
        )
    for name in texts.COLMAP:
        yield f"colmap {name}", _colmap(name)
    for name in texts.ANNOTATIONS:
        yield f"annotations {name}", _annotations(name, False)
        yield f"annotations {name}, dropping", _annotations(name, True)
    yield "classes of kpf", _types()
    yield "activities", _text("clip.activities.yml", texts.ACTIVITIES, read_activities)
    for name, text in texts.HOMOGRAPHIES.items():
        for read in (read_ground_map, read_reference):
            file = "a_homography_img2world.txt"
            yield f"{read.__name__} {name}", _text(file, text, partial(read, image_size=size))
    yield "points", _text("p.csv", texts.POINTS, partial(read_points, image_size=size))
    yield "orientation", _text("o.json", texts.ORIENTATION, Orientation.load)
    yield "landmarks", _text("l.json", texts.LANDMARKS, Landmarks.load)
    yield "landmark table", _text("l.csv", texts.LANDMARK_TABLE, Landmarks.load)
    yield "anchors", _text("a.json", texts.ANCHORS, read_anchors)
    yield "anchor table", _text("a.csv", texts.ANCHOR_TABLE, read_anchors)
    yield "zones", _text("z.json", texts.PLACES, lambda path: read_places(path, ["c"]))
    yield "zones in GeoJSON", _text("z.json", texts.GEOJSON, lambda path: read_places(path, ["c"]))
    yield "catalogue", _text("c.yaml", texts.CATALOGUE, load_catalogue)
    yield "calibration", Sample(_calibration, Calibration.load)
    yield "camera of a calibration", Sample(_calibration, Camera.load)
    yield "events", Sample(_event, _events)
    for what in ("runs/r.json", "cameras/c.json", "tracks/**/*.parquet"):
        yield f"scene {what}", _in_scene(what)
    for file in ("site.json", "identities*.parquet"):
        yield f"site {file}", _in_site(file)
    for file in ("settings.json", "finished.json", "00000.npz"):
        yield f"log {file}", _log(file)
    yield "table", Sample(_table, read_table)
    for ending in (".jpg", ".png", ".bmp", ".tif", ".webp"):
        yield f"picture {ending}", _picture(ending)
    for ending, codec in (
        (".mp4", "mpeg4"),
        (".avi", "mjpeg"),
        (".mkv", "mpeg4"),
        (".ts", "mpeg2video"),
    ):
        yield f"video {ending}", _video(ending, codec)


SAMPLES = dict(_samples())


def spoilt(content: bytes, rng: random.Random) -> bytes:
    """A few changes, of a kind that suits the content."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return _bytes_spoilt(content, rng)
    if text[:1] in "{[" and rng.random() < 0.5:
        return _json_spoilt(text, rng).encode("utf-8", "surrogatepass")
    return _text_spoilt(text, rng).encode()


def _text_spoilt(text: str, rng: random.Random) -> str:
    """Up to three tokens instead of some characters, of a whole word, or of a number."""
    for _ in range(rng.randint(1, 3)):
        start = rng.randrange(len(text) + 1)
        end = start + rng.randint(0, 4)
        if rng.random() < 0.6:  # a whole word
            while start and text[start - 1].isalnum():
                start -= 1
            while end < len(text) and (text[end].isalnum() or text[end] in ".-"):
                end += 1
        text = text[:start] + rng.choice(TOKENS) + text[end:]
    return text


def _json_spoilt(text: str, rng: random.Random) -> str:
    """One value is another one, is gone, or is there twice."""
    try:
        values = json.loads(text)
    except ValueError:
        return _text_spoilt(text, rng)
    places = [*_places(values)]
    if places:
        holder, key = rng.choice(places)
        other = rng.choice(VALUES) if rng.random() < 0.7 else rng.choice(places)
        holder[key] = (
            json.loads(json.dumps(other[0][other[1]])) if isinstance(other, tuple) else other
        )
        if rng.random() < 0.2:
            del holder[key]
    return json.dumps(values)


def _places(values: Any) -> Iterator[tuple[Any, Any]]:
    """Every value within, as what holds it and its key."""
    inner = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in [*inner]:
        yield values, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _bytes_spoilt(content: bytes, rng: random.Random) -> bytes:
    """Bytes changed, cut out, moved or cut off; near an end half of the time, where headers are."""
    made = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 8])):
        if not made:
            break
        near = min(len(made), 400)
        at = rng.choice([rng.randrange(len(made)), rng.randrange(near), -1 - rng.randrange(near)])
        at %= len(made)
        kind = rng.random()
        if kind < 0.6:
            made[at] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, made[at] ^ (1 << rng.randrange(8))])
        elif kind < 0.75:
            made[at : at + 4] = rng.randbytes(4)
        elif kind < 0.85:
            del made[at : at + rng.randint(1, 64)]
        elif kind < 0.95:
            made[at:at] = made[rng.randrange(len(made)) :][: rng.randint(1, 64)]
        else:
            del made[at:]
    return bytes(made)


def misread(read: Read, path: Path) -> Exception | str | None:
    """What should not have happened when a spoilt file was read; None if all is well."""
    try:
        read(path)
    except InputError as error:
        message = str(error)
        bare = message.replace(str(path), "").replace(str(path.parent), "")
        if len(bare) >= 500 or "\x1b" in message:
            return f"an unreadable message: {message[:600]!r}"
        if path.name not in message and path.parts[2] not in message:
            return f"a message that names no file: {message!r}"
    except Scene4DError:
        return None
    except Exception as error:  # whatever it is
        return error
    return None
