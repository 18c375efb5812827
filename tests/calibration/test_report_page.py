"""The written report: files, numbers, words, and what happens when it cannot be written."""

import re
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from html.parser import HTMLParser
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
import pytest

import report_scenes as scenes
from scene4d.calibration import CalibrateOptions
from scene4d.calibration.calibrating import Run, run_detections
from scene4d.calibration.report._page import FIGURES, report_files
from scene4d.calibration.writing import write
from scene4d.core.errors import InputError
from scene4d.core.progress import Silent
from scene4d.core.tables import read_table
from scene4d.drawing import words
from scene4d.drawing.overlay import draw_overlay
from scene4d.drawing.page import EMBED_BYTES, data_uri, seconds_text
from scene4d.formats.demo import demo_detections

VOID = {"meta", "img", "br", "hr", "link"}


class Page(HTMLParser):
    """Balanced tags, images, header cells and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.headers: list[dict[str, str | None]] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.links += [v for k, v in attrs if k in ("src", "href", "srcset", "action") and v]
        if tag == "img":
            self.images.append(values)
        if tag == "th":
            self.headers.append(values)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data


def write_report(folder: Path, calibration, *, source_name="footage", **more) -> Path:
    """Report and figures in a folder."""
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name, content in report_files(Run(calibration, source_name, **more)).items():
        (folder / name).write_bytes(content)
    return folder / "report.html"


def background(size: tuple[int, int] = (768, 576)) -> np.ndarray:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (size[1] // 8, size[0] // 8, 3), dtype=np.uint8)
    return cv2.resize(noise, size)


def read(folder: Path) -> tuple[str, Page]:
    text = (folder / "report.html").read_text(encoding="utf-8")
    return text, Page(text)


def decoded(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path))
    assert pixels is not None
    return pixels


def write_whole(folder: Path) -> Path:
    made = {"command": "scene4d calibrate 'lobby & yard.mp4' --out out", "version": "9.8.7"}
    warnings = ("k1 was <held> at 0", "few people")
    calibration = scenes.calibration(warnings=warnings, made=made)
    return write_report(
        folder,
        calibration,
        image_bgr=background(),
        source_name="lobby & yard.mp4",
        timings={"Finding people": 12.44, "Solving": 0.004},
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "out"
    assert write_whole(folder) == folder / "report.html"
    return folder


def test_every_file_is_there_and_nothing_else(whole):
    files = {str(p.relative_to(whole)) for p in whole.rglob("*") if p.is_file()}
    assert files == {"report.html", *(f"figures/{n}.png" for n in FIGURES)}
    assert (whole / "report.html").stat().st_size < 3_000_000


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_pictures_of_report_width_and_not_blank(whole, name):
    pixels = decoded(whole / "figures" / f"{name}.png")
    assert 700 <= pixels.shape[1] <= 1300 and 300 <= pixels.shape[0] <= 1400
    assert pixels.reshape(-1, 3).std(axis=0).min() > 10
    assert (pixels[-3:] == 255).all(), "the legend is cut off at the lower edge"


def test_the_page_stands_alone(whole):
    text, page = read(whole)
    assert all(link.startswith("data:image/") for link in page.links)
    assert len(page.links) == len(FIGURES)
    without_data = re.sub(r"data:image/[^\"]+", "", text)
    assert not re.search(r"https?:|//[a-z]|@import|url\(|<script|<link", without_data)


def test_the_page_says_the_numbers(whole):
    _, page = read(whole)
    first = page.text.index("Camera found: 7.07 ± 0.14\u00a0m above the ground")
    assert "looking 16.5° ± 0.3° down" in page.text
    assert "Feet and heads cannot show it" in page.text and "not mirrored" in page.text
    assert "about 0.38\u00a0m within the scene and 2.1\u00a0m from the camera" in page.text
    assert "(medians over the ground in view, out to 31\u00a0m)." in page.text
    assert (
        first < page.text.index("What the camera sees") < page.text.index("The ground from above")
    )
    assert "−3.1° ± 0.2°" in page.text and "1185 ± 24\u00a0px" in page.text
    assert "Within the scene: median 0.38\u00a0m, nine in ten places below 0.90\u00a0m" in page.text
    assert "where people walked, the median is 0.26\u00a0m" in page.text
    assert "From the camera: median 2.1\u00a0m, nine in ten places below 3.4\u00a0m" in page.text
    assert "120 sightings" in page.text and "106 (88%)" in page.text
    assert "9.8.7" in page.text and "12.4" in page.text and "below 0.1" in page.text


def test_text_from_outside_is_escaped(whole):
    text, page = read(whole)
    assert "k1 was &lt;held&gt; at 0" in text and "<held>" not in text
    assert "lobby & yard.mp4" in page.text and "lobby &amp; yard.mp4" in text


def test_the_page_is_accessible(whole):
    text, page = read(whole)
    assert '<html lang="en">' in text and "prefers-color-scheme: dark" in text
    assert "@media print" in text
    assert all(len(image["alt"] or "") > 20 for image in page.images)
    assert all(header["scope"] in ("row", "col") for header in page.headers)
    assert len(page.headers) > 15


def test_an_undetermined_camera_gets_the_reason_and_no_geometry(tmp_path):
    for found in (scenes.calibration(), scenes.undetermined()):
        write(Run(found, "footage", background()), tmp_path, progress=Silent())
        assert (tmp_path / "figures" / "birdseye.png").exists() == bool(found)
    text, page = read(tmp_path)
    assert "all people stand at <one> distance." in page.text and "&lt;one&gt;" in text
    assert "What would determine it" in page.text and "--lens" in page.text
    assert "±" not in page.text and "Camera found" not in page.text
    assert [p.name for p in (tmp_path / "figures").iterdir()] == ["overlay.png"]
    assert len(page.images) == 1


def test_a_camera_of_an_undetermined_calibration_is_never_drawn(tmp_path):
    rejected = scenes.undetermined(camera=scenes.camera(), covariance=scenes.COVARIANCE)
    write_report(tmp_path / "a", rejected)
    write_report(tmp_path / "b", scenes.undetermined())
    assert [p.name for p in (tmp_path / "a" / "figures").iterdir()] == ["overlay.png"]
    name = "figures/overlay.png"
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_same_input_gives_the_same_bytes_and_changes_no_global_settings(whole, tmp_path):
    import matplotlib

    before = dict(matplotlib.rcParams)
    write_whole(tmp_path)
    assert dict(matplotlib.rcParams) == before
    for path in ("report.html", "figures/overlay.png", "figures/birdseye.png"):
        assert (whole / path).read_bytes() == (tmp_path / path).read_bytes()


_UNCERTAIN = ("covariance", "ground_error_m", "ground_error_from_camera_m")
SCENES = {
    "strong barrel": ({"distortion": (-0.3, 0, 0, 0, 0), "focal_px": 400.0}, 60, {}),
    "straight down": ({"tilt_rad": np.pi / 2, "focal_px": 300.0}, 20, {}),
    "nadir in view": ({"tilt_rad": np.radians(75), "focal_px": 400.0}, 40, {}),
    "large and upright": ({"image_size": (2160, 3840), "focal_px": 3200.0}, 40, {}),
    "no covariance": ({}, 20, dict.fromkeys(_UNCERTAIN)),
    "nobody agrees": ({}, 20, {"inlier": np.zeros(20, bool)}),
    "no segments": ({}, 20, {"segments": None, "inlier": None, "residual": None}),
}


@pytest.mark.parametrize("name", SCENES)
def test_unusual_scenes_without_a_frame_give_a_page(tmp_path, name):
    changes, n, fields = SCENES[name]
    calibration = scenes.calibration(scenes.camera(**changes), n, **fields)
    write_report(tmp_path, calibration)
    _, page = read(tmp_path)
    assert "Camera found: 7.07" in page.text and "nan" not in page.text.lower()
    for image in (tmp_path / "figures").iterdir():
        pixels = decoded(image)
        assert pixels.shape[1] <= 1300 and pixels.shape[0] <= 1400


def test_twenty_thousand_people_are_thinned_and_the_page_says_so(tmp_path):
    calibration = scenes.calibration(n=100)
    many = calibration.segments.select(np.arange(20_000) % 100)
    agreed = np.arange(20_000) % 9 > 0
    calibration = scenes.calibration(segments=many, inlier=agreed, residual=np.zeros(20_000))
    write_report(tmp_path, calibration)
    _, page = read(tmp_path)
    assert "An even sample of the people is drawn." in page.text
    assert "20\u202f000 sightings" in page.text


def test_a_frame_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"\(576, 768, 3\).*\(240, 320, 3\)"):
        report_files(Run(scenes.calibration(n=10), "", background((320, 240))))


def test_the_real_scene_is_drawn(tmp_path, shared_data):
    """PETS 2009 View_001 with its first frame: files whole, horizon above the picture."""
    capture = cv2.VideoCapture(str(shared_data / "pets2009" / "vtest.avi"))
    ok, frame = capture.read()
    capture.release()
    assert ok
    (tmp_path / "overlay.png").write_bytes(draw_overlay(scenes.calibration(), frame).png)
    overlay = decoded(tmp_path / "overlay.png")
    shown = cv2.resize(frame, (overlay.shape[1], round(overlay.shape[1] * 576 / 768)))
    # The horizon lies above the frame, and the canvas goes on to it.
    below = np.array([_match(overlay, shown, row) for row in range(len(overlay) - len(shown))])
    assert below.min() < 6 and below.argmin() > 60
    canvas = overlay[: below.argmin() - 2].reshape(-1, 3)
    assert (np.abs(canvas.astype(int) - (82, 73, 65)).max(axis=1) < 3).mean() > 0.5
    cyan = (canvas[:, 0] > 180) & (canvas[:, 1] > 180) & (canvas[:, 2] < 140)
    assert cyan.sum() > 500, "the horizon is drawn on the canvas"


def _match(overlay: np.ndarray, shown: np.ndarray, row: int) -> float:
    part = overlay[row : row + len(shown) : 4, ::4].astype(float)
    return float(np.median(np.abs(part - shown[::4, ::4])))


def test_people_stand_where_the_solver_puts_them(tmp_path, monkeypatch):
    """Feet are seen 4 cm above the ground: at a camera of 3 m that is a third of a metre at 25."""
    camera = scenes.camera(height_m=3.0, tilt_rad=np.radians(8))
    calibration = scenes.calibration(camera, 40)
    _, xy_m, _ = scenes.people(camera, 40)
    monkeypatch.setattr("scene4d.calibration.report._page._draw", lambda *_: {})
    write(Run(calibration, "footage"), tmp_path, progress=Silent())
    table = read_table(tmp_path / "people.parquet")
    np.testing.assert_allclose(np.column_stack([table["x_m"], table["y_m"]]), xy_m, atol=1e-6)


def test_a_calibration_says_what_made_it():
    people = demo_detections()
    found = run_detections(
        people, CalibrateOptions(), Silent(), "the table", command="scene4d demo"
    ).calibration
    assert found.to_dict()["made"] == found.made
    assert found.made["source"] == "the table" and found.made["command"] == "scene4d demo"
    assert found.made["version"] == version("scene4d")
    age = datetime.now(UTC) - datetime.fromisoformat(found.made["date"])
    assert timedelta(0) <= age + timedelta(seconds=1) < timedelta(minutes=5)
    # Both errors are there, and the camera's own frame is known less well than the scene.
    within, outside = found.ground_error_m, found.ground_error_from_camera_m
    assert 0 < within["median"] < outside["median"] and within["p90"] < outside["p90"]


def test_big_pictures_are_embedded_within_the_budget():
    noise = np.random.default_rng(0).integers(0, 255, (900, 1200, 3), dtype=np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    png = cv2.imencode(".png", smooth)[1].tobytes()
    uri = data_uri(png)
    assert uri.startswith("data:image/webp;base64,") and len(uri) < 1.4 * EMBED_BYTES < len(png)
    small = cv2.imencode(".png", smooth[:64, :64])[1].tobytes()
    assert data_uri(small).startswith("data:image/png;base64,")


@pytest.mark.parametrize(
    ("value", "sigma", "unit", "text"),
    [
        (7.0712, 0.2, "m", "7.1 ± 0.2\u00a0m"),
        (7.0712, 0.14, "m", "7.07 ± 0.14\u00a0m"),
        (16.482, 0.31, "°", "16.5° ± 0.3°"),
        (1185.4, 23.0, "px", "1185 ± 23\u00a0px"),
        (-3.09, 0.0, "°", "−3.09° (given)"),
        (7.0712, None, "m", "7.07\u00a0m"),
        (-0.0001, 0.1, "°", "0.00° ± 0.10°"),
        (0.0123, 0.0009, "", "0.0123 ± 0.0009"),
        (12345.0, 999.0, "px", "12\u202f345 ± 999\u00a0px"),
    ],
)
def test_numbers_carry_the_digits_that_their_uncertainty_allows(value, sigma, unit, text):
    assert words.plus_minus(value, sigma, unit) == text


def test_the_interval_of_a_positive_quantity_stays_positive():
    wide = scenes.COVARIANCE.copy()
    wide[3, 3] = 0.8**2
    row = next(
        r for r in words.parameter_rows(scenes.calibration(covariance=wide)) if r.name == "Height"
    )
    low, high = (float(x.replace("\u00a0m", "")) for x in row.interval.split(" to "))
    assert 0 < low < 7.07 < high
    assert high == pytest.approx(7.07 * np.exp(1.96 * 0.8), abs=0.5)


def test_a_camera_that_looks_up_is_said_to():
    upward = scenes.calibration(scenes.camera(tilt_rad=np.radians(-1.0), height_m=7.07), n=10)
    assert "looking 1.0° ± 0.3° up" in words.verdict(upward)


def test_seconds():
    assert [seconds_text(s) for s in (0.0, 0.04, 0.05, 71.26)] == [
        "below 0.1",
        "below 0.1",
        "0.1",
        "71.3",
    ]


def test_importing_the_layer_is_light_and_drawing_needs_no_pyplot():
    code = (
        "import sys, scene4d.calibration.report._page\n"
        "print([m for m in ('matplotlib', 'cv2', 'jinja2', 'scipy') if m in sys.modules])\n"
        "from scene4d.drawing import birdseye, histogram, overlay\n"
        "from scene4d.calibration.report import _errormap\n"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["[]", "False"]
