"""The page of a search: clips, paths from above, and why."""

import io
import math
import re
from dataclasses import replace

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import finding_scenes as scenes
from scene4d.core.calibration import Calibration
from scene4d.core.tracks import Tracks
from scene4d.searching import SearchOptions, understand
from scene4d.searching._places import Place, Places
from scene4d.searching.activities._events import Event
from scene4d.searching.pages._clip import (
    CLIP_PX,
    Clip,
    Crop,
    crop_region,
    cut_out,
    mp4,
    still,
    stills,
)
from scene4d.searching.pages._page import search_html
from scene4d.searching.pages._plan import plan_svg
from scene4d.searching.pages._rings import Ring, Rings
from scene4d.searching.predicates import NEAR_TAU_M
from scene4d.searching.result import FoundEvent, SearchResult, why_groups
from scene4d.store.footage import NoFootage
from scene4d.store.query import Scene

SIZE = (640, 480)
THREE = scenes.people()[0].select(np.arange(3))
WHY = {
    "comes: near(person, vehicle)": 0.9,
    "vanishes: disappears(person)": 0.8,
    "vanishes: arm_moving_up(person)": math.nan,
    "without a break": 0.7,
}


def event(begin_s=7.0, end_s=12.0, **roles) -> Event:
    roles = roles or {"person": scenes.PERSON, "vehicle": scenes.PARKED}
    return Event("person_enters_vehicle", 0.25, 0.71, begin_s, end_s, roles, WHY)


def around() -> Tracks:
    return Tracks.concatenate([*scenes.people(), scenes.parked()])


def crops(count: int, size=(120, 80)) -> tuple[Crop, ...]:
    picture = np.zeros((size[1], size[0], 3), np.uint8)
    return tuple(Crop(float(number), picture + 10 * number) for number in range(count))


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    everybody = [*scenes.people(), scenes.parked()]
    return Scene.open(scenes.write_scene(tmp_path_factory.mktemp("page") / "scene", everybody))


def found(scene, rows=None, **roles) -> FoundEvent:
    return FoundEvent(event(**roles), scene.runs[0], 70, 120, around() if rows is None else rows)


def page(scene, *clips: Clip | NoFootage, notes=()) -> str:
    asked = understand(scene, "person enters vehicle", SearchOptions())
    asked = replace(asked, query=replace(asked.query, text="a <b> & c"), notes=tuple(notes))
    result = SearchResult(asked, [found(scene) for _ in clips], [scene.runs[0]])
    return search_html(result, list(clips), "scene4d search")


@given(
    st.floats(-50, 700), st.floats(-50, 500), st.floats(1, 700), st.floats(1, 500), st.booleans()
)
def test_a_region_lies_in_the_picture_and_holds_what_is_in_it(x, y, width, height, bridged):
    rows = THREE
    boxes = np.tile([x, y, x + width, y + height], (3, 1))
    if bridged:
        boxes[1] = np.nan
    rows = replace(rows, box_xyxy=boxes)
    one = event(float(rows.time_s[0]), float(rows.time_s[-1]), person=scenes.PERSON)
    x1, y1, x2, y2 = crop_region(rows, one, SIZE)
    assert 0 <= x1 < x2 <= SIZE[0]
    assert 0 <= y1 < y2 <= SIZE[1]
    inside = np.clip([x, y, x + width, y + height], 0, [*SIZE, *SIZE])
    if x >= 0 and y >= 0 and x + width <= SIZE[0] and y + height <= SIZE[1]:
        assert x1 <= inside[0] + 1
        assert y1 <= inside[1] + 1
        assert x2 >= inside[2] - 1
        assert y2 >= inside[3] - 1


def test_nobody_with_a_box_is_no_region():
    assert crop_region(None, event(), SIZE) is None
    assert crop_region(around(), event(person=123), SIZE) is None
    assert crop_region(around(), event(90.0, 95.0), SIZE) is None


def test_boxes_are_drawn_where_they_are():
    image = np.full((480, 640, 3), 90, np.uint8)
    region = (100, 90, 300, 210)
    plain = cut_out(image, region, {"person": None})
    drawn = cut_out(image, region, {"person": np.array([150.0, 120.0, 200.0, 200.0])})
    assert drawn.shape == plain.shape
    assert max(drawn.shape) == CLIP_PX
    assert drawn.shape[0] % 2 == drawn.shape[1] % 2 == 0
    changed = np.argwhere((drawn != plain).any(axis=2))
    scale = CLIP_PX / 200
    low, high = changed.min(axis=0), changed.max(axis=0)
    np.testing.assert_allclose(low, [30 * scale, 50 * scale], atol=4)
    np.testing.assert_allclose(high, [110 * scale, 100 * scale], atol=4)


def test_the_ring_is_where_the_camera_sees_what_is_near(scene):
    """Every point of it projects from τ metres around the vehicle; those inside have P above ½."""
    calibration = Calibration.load(scene.camera_file(scene.runs[0].camera))
    activity = understand(scene, "person enters vehicle", SearchOptions()).query.activity
    one = found(scene)
    rings = Rings(one, activity, calibration)
    (ring,) = rings.at(80)
    assert ring.role == "vehicle"
    rows = one.around.select(one.around.frame == 80)
    at = dict(zip(rows.track.tolist(), rows.xy_m, strict=True))
    seen = np.isfinite(ring.outline_uv).all(axis=1)
    assert seen.any()
    xy = calibration.camera.locate(ring.outline_uv[seen])[0]
    np.testing.assert_allclose(np.hypot(*(xy - at[scenes.PARKED]).T), NEAR_TAU_M, rtol=1e-6)
    feet = calibration.camera.locate(ring.feet_uv)[0]
    apart = np.hypot(*(feet - at[scenes.PARKED]).T)
    person = np.hypot(*(at[scenes.PERSON] - at[scenes.PARKED]))
    assert np.isclose(apart, person).any()
    np.testing.assert_array_equal(ring.probability > 0.5, apart < NEAR_TAU_M)
    assert list(rings.at(10**6)) == []
    away = replace(activity, phases=())
    assert list(Rings(one, away, calibration).at(80)) == []


def test_rings_and_their_numbers_are_drawn():
    image = np.full((480, 640, 3), 90, np.uint8)
    angle = np.linspace(0, 2 * np.pi, 50)
    outline = np.stack([200 + 60 * np.cos(angle), 150 + 30 * np.sin(angle)], axis=1)
    outline[:5] = np.nan
    ring = Ring("person", outline, np.array([[190.0, 140.0]]), np.array([0.75]))
    region, boxes = (100, 90, 300, 210), {"person": None}
    plain, drawn = (cut_out(image, region, boxes, rings) for rings in ((), (ring,)))
    changed = np.argwhere((drawn != plain).any(axis=2))
    low, high = changed.min(axis=0), changed.max(axis=0)
    np.testing.assert_allclose(low, [60, 80], atol=4)
    np.testing.assert_allclose(high, [180, 320], atol=6)
    bare = cut_out(image, region, boxes, [replace(ring, probability=np.array([np.nan]))])
    assert (bare != drawn).any(axis=2).sum() > 50


def test_the_clip_decodes_to_what_went_in():
    content = mp4(crops(20), 10.0)
    with av.open(io.BytesIO(content)) as container:
        frames = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
        assert container.streams.video[0].codec_context.name == "h264"
    assert len(frames) == 20
    assert [frame.mean() for frame in frames] == pytest.approx(
        [10.0 * number for number in range(20)], abs=6
    )


def test_stills_are_spread_from_first_to_last():
    assert [one.time_s for one in stills(Clip(crops(10), 10.0))] == [0, 3, 6, 9]
    assert [one.time_s for one in stills(Clip(crops(2), 10.0))] == [0, 1]
    small = cv2.imdecode(np.frombuffer(still(crops(1)[0], 60), np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (40, 60, 3)


def test_the_bars_are_grouped_by_phase():
    assert why_groups(WHY) == [
        ("comes", [("near(person, vehicle)", "0.90", 0.9)]),
        (
            "vanishes",
            [
                ("disappears(person)", "0.80", 0.8),
                ("arm_moving_up(person)", "cannot be judged, counts ½", 0.5),
            ],
        ),
        ("", [("without a break", "0.70", 0.7)]),
    ]


def coordinates(svg: str, pattern: str) -> np.ndarray:
    (text,) = re.findall(pattern, svg)
    return np.array([pair.split(",") for pair in text.split()], float)


def test_the_plan_shows_each_role_in_its_colour_where_it_went(scene):
    svg = plan_svg(found(scene), Places())
    person = coordinates(
        svg, r'<polyline points="([^"]*)" fill="none" stroke="#E69F00" stroke-width="4"'
    )
    walked = scenes.people()[0].xy_m
    # One scale, x to the right, y upwards.
    moved = person[-1] - person[0]
    scale = moved[0] / (walked[-1] - walked[0])[0]
    assert 20 < scale < 60
    np.testing.assert_allclose(moved, scale * (walked[-1] - walked[0]) * [1, -1], atol=0.2)
    (x, y), size = re.findall(r'<rect x="([\d.]+)" y="([\d.]+)"', svg)[0], 10  # who stands
    expected = person[0] + scale * (np.array(scenes.CAR) - walked[0]) * [1, -1]
    np.testing.assert_allclose([float(x) + size / 2, float(y) + size / 2], expected, atol=0.3)
    assert re.findall(r">([\d.]+ s)<", svg) == ["0 s", "2 s", "4 s"]
    assert plan_svg(found(scene), Places()) == svg


def test_the_plan_shows_the_places_of_its_camera(scene):
    bay = np.array([[-1.0, 13.0], [1.0, 13.0], [1.0, 16.0]])
    both = Places((Place("zone", "a <b>", bay), Place("line", "far", bay, "elsewhere")))
    svg = plan_svg(found(scene), both)
    assert "a &lt;b&gt;" in svg
    assert "far" not in svg
    (corners,) = re.findall(r'<polyline points="([^"]*)"[^>]*stroke-dasharray="5 3"', svg)
    assert len(corners.split()) == 4  # closed


def test_nobody_with_a_position_has_no_plan(scene):
    rows = around()
    nowhere = replace(rows, xy_m=np.full_like(rows.xy_m, np.nan))
    assert plan_svg(found(scene, nowhere), Places()) is None
    assert plan_svg(found(scene, person=123), Places()) is None
    assert plan_svg(replace(found(scene), around=None), Places()) is None


def test_the_page_holds_everything_itself(scene):
    gone = NoFootage("It is gone.")
    html = page(scene, Clip(crops(12), 10.0, 2.0), gone, notes=["mind <this>"])
    assert html.count("data:video/mp4;base64,") == 1
    assert html.count("<svg xmlns") == 2
    assert html.count("<figcaption>") == 4
    assert "2 times as fast" in html
    assert html.count("No pictures. It is gone.") == 1
    assert "a &lt;b&gt; &amp; c" in html
    assert "mind &lt;this&gt;" in html
    assert not re.search(r'(src|href)="(?!data:|#)', html)
    widths = re.findall(r'class="bar( unknown)?"><i style="width:([\d.]+)%', html)
    assert widths[:4] == [("", "90.0"), ("", "80.0"), (" unknown", "50.0"), ("", "70.0")]


def test_nothing_found_is_a_page_too(scene):
    html = page(scene)
    assert "Nothing found in 1 clip" in html
    assert "<h2>Events</h2>" not in html


def test_without_an_encoder_there_are_stills_and_it_is_said(scene, monkeypatch):
    monkeypatch.setattr("scene4d.searching.pages._page.mp4", lambda *_: None)
    html = page(scene, Clip(crops(4), 10.0))
    assert "no encoder for H.264" in html
    assert "<video" not in html
