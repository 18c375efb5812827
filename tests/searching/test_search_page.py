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
from scene4d.core.tracks import Tracks
from scene4d.searching.activities.events import Event
from scene4d.searching.pages.clip import (
    CLIP_PX,
    Clip,
    Crop,
    crop_region,
    cut_out,
    jpeg,
    mp4,
    stills,
)
from scene4d.searching.pages.page import EventCard, SearchPage, search_html
from scene4d.searching.pages.paths import draw_paths
from scene4d.searching.pages.why import why_groups

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


def card(**changes) -> EventCard:
    given = {"missing": "It is gone.", **changes}
    return EventCard(event(), "00:07.0 to 00:12.0", [("camera", "gate")], around(), **given)


def page(*cards: EventCard, notes=()) -> str:
    return search_html(SearchPage("a <b> & c", ["near(a, b)"], "1 event.", notes), cards)


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
    small = cv2.imdecode(np.frombuffer(jpeg(crops(1)[0], 60), np.uint8), cv2.IMREAD_COLOR)
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


def test_paths_show_each_role_in_its_colour():
    content = draw_paths(around(), event())
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    for colour in ((0x00, 0x9F, 0xE6), (0xE9, 0xB4, 0x56)):  # orange and blue, as BGR
        assert (np.abs(picture.astype(int) - colour).max(axis=2) < 12).sum() > 60
    assert draw_paths(around(), event()) == content


def test_paths_show_the_places():
    bay = np.array([[-1.0, 13.0], [1.0, 13.0], [1.0, 16.0]])
    plain = draw_paths(around(), event())
    assert draw_paths(around(), event(), zones={"bay": bay}) != plain
    assert draw_paths(around(), event(), lines={"gate": bay}) != plain


def test_nobody_with_a_position_has_no_paths():
    rows = around()
    assert draw_paths(replace(rows, xy_m=np.full_like(rows.xy_m, np.nan)), event()) is None
    assert draw_paths(rows, event(person=123)) is None


def test_the_page_holds_everything_itself():
    html = page(card(clip=Clip(crops(12), 10.0, 2.0)), card(), notes=["mind <this>"])
    assert html.count("data:video/mp4;base64,") == 1
    assert html.count('class="above" src="data:image/png;base64,') == 2
    assert html.count("<figcaption>") == 4
    assert "2 times as fast" in html
    assert html.count("It is gone.") == 1
    assert "a &lt;b&gt; &amp; c" in html
    assert "mind &lt;this&gt;" in html
    assert not re.search(r'(src|href)="(?!data:|#)', html)
    widths = re.findall(r'class="bar( unknown)?"><i style="width:([\d.]+)%', html)
    assert widths[:4] == [("", "90.0"), ("", "80.0"), (" unknown", "50.0"), ("", "70.0")]


def test_nothing_found_is_a_page_too():
    html = page()
    assert "1 event." in html
    assert "<h2>Events</h2>" not in html


def test_without_an_encoder_there_are_stills_and_it_is_said(monkeypatch):
    monkeypatch.setattr("scene4d.searching.pages.page.mp4", lambda *_: None)
    html = page(card(clip=Clip(crops(4), 10.0)))
    assert "no encoder for H.264" in html
    assert "<video" not in html
