"""Searching a site: across views, each event once, and as each camera alone sees it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.searching import SearchOptions, search
from scene4d.store.identities import Identities
from scene4d.store.query import Scene
from scene4d.store.site import Site
from scene4d.store.site_file import SiteFile
from scene4d.store.site_writing import write_site
from site_worlds import Eye, Walker, place, seen, store

WEST = Eye("west", place(-30.0, 0.0, 20.0), (-8.0, 0.0), 10.0, 0.05)
EAST = Eye("east", place(25.0, 6.0, 170.0, 1.02, 4.0), (8.0, 0.0), 10.0, 0.05)
WORDS = "person is in zone entrance, then the person is in zone till"


def walker(start, end, begin_s=2.0, stays_s=5.0, kind="person") -> Walker:
    """Stands, goes, and stands."""
    seconds = float(np.hypot(*np.subtract(end, start))) / 1.3
    time_s = np.arange(begin_s, begin_s + seconds + 2 * stays_s, 0.1)
    share = np.clip((time_s - begin_s - stays_s) / seconds, 0, 1)[:, None]
    return Walker(time_s, np.array(start) + share * (np.array(end, float) - start), kind)


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Site:
    """Somebody walks from one view into the other; somebody stays in the first."""
    folder = tmp_path_factory.mktemp("shop")
    walkers = [walker((-12.0, 0.0), (12.0, 1.0)), walker((-12.0, 3.0), (-5.0, 3.0), 8.0)]
    cameras, rows = {}, []
    for eye in (WEST, EAST):
        tracks, whose = seen(eye, walkers)
        cameras[eye.name] = store(folder / eye.name, eye, tracks, run=f"run-{eye.name}")
        rows += [(eye.name, track, who + 1, 1.0) for track, who in whose.items()]
    known = Identities(*(np.array(column) for column in zip(*rows, strict=True)))
    write_site(folder / "site", SiteFile(cameras), known, refined={}, pictures={})
    return Site.open(folder / "site")


@pytest.fixture(scope="module")
def zones(tmp_path_factory):
    """One zone in the site's metres, the other in those of the second camera."""

    def square(x, y):
        return np.array([[x - 3, y - 3], [x + 3, y - 3], [x + 3, y + 3], [x - 3, y + 3]], float)

    till = EAST.placement.inverse().points(square(12.0, 1.0))
    path = tmp_path_factory.mktemp("zones") / "zones.json"
    said = {
        "entrance": square(-12.0, 1.0).tolist(),
        "till": {"camera": "east", "points": till.tolist()},
    }
    path.write_text(json.dumps({"zones": said}))
    return path


def test_one_person_in_a_zone_of_one_view_and_then_in_a_zone_of_another(site, zones):
    found = search(site, WORDS, zones=zones)
    assert len(found) >= 1
    best = found.to_dict()["events"][0]
    assert best["identities"] == {"person": 1}
    assert set(best["cameras"]) == {"west", "east"}
    assert best["score"] > 0.5
    assert all(one["identities"]["person"] == 1 for one in found.to_dict()["events"])
    assert best["site_end_s"] > 20
    assert {one["camera"] for one in found.to_dict()["events"]} <= {"west", "east"}
    ((_, clock),) = site.runs(best["camera"])
    assert best["begin_s"] == pytest.approx(clock.in_clip(best["site_begin_s"]))
    assert found.events[0].course is not None and found.events[0].around is not None


def test_what_two_cameras_see_at_one_time_is_one_event(site):
    """Around the middle both see the walker; what each ends on its own stays two."""
    alone = search(site.whole()[0], "person walks")
    once = search(site, "person walks")
    assert len(once) < len(alone)
    merged = [one for one in once.to_dict()["events"] if len(one["cameras"]) == 2]
    assert len(merged) == 1 and merged[0]["identities"] == {"person": 1}


def test_pictures_are_searched_by_camera_and_merged_by_identity(site):
    found = search(site, "person_leaves_scene", min_score=0.0)
    events = found.to_dict()["events"]
    assert {one["camera"] for one in events} == {"west", "east"}
    assert all(one["identities"]["person"] in (1, 2) for one in events)
    frame = found.to_arrow()
    assert frame.num_rows == len(events)


def test_a_site_is_searched_by_itself(site):
    with pytest.raises(InputError, match="search a site by itself"):
        search([site.folder, site.placed("west").scene], "person walks")
    by_path = search(str(site.folder), "person walks", SearchOptions(top=1))
    assert by_path.asked.site is not None and len(by_path.shown) == 1
    assert isinstance(by_path.asked.scene, Scene)


def test_merging_keeps_what_has_no_identity_and_other_times_apart(site):
    from scene4d.searching._across import _once

    (first, *_) = search(site, "person walks").events
    other = replace(first, across={**first.across, "cameras": ["north"]})
    late = replace(other, across={**other.across, "site_begin_s": 500.0, "site_end_s": 510.0})
    nobody = replace(other, across={**other.across, "identities": {"person": None}})
    merged = _once([first, other, late, nobody, nobody])
    assert merged[0].across["cameras"][-1] == "north"
    assert len(merged) == 4


def test_where_another_stood_is_looked_up_in_all_cameras(tmp_path):
    """In the west somebody stands where a car was parked, and where only the east saw another one
    stand: once in the middle, which both cameras see, at places that each measures anew.
    """
    west, east = (replace(eye, radius_m=16.0, noise_m=0.02, shared_m=0.02) for eye in (WEST, EAST))
    still = np.arange(0.0, 12.0, 0.1)
    early = [
        Walker(still, np.tile([6.0, 0.0], (len(still), 1))),
        Walker(still, np.tile([-1.0, 5.0], (len(still), 1)), "car"),
    ]
    late = [
        Walker(still + 40, np.tile([6.3, 0.0], (len(still), 1))),
        Walker(still + 60, np.tile([-1.2, 5.0], (len(still), 1))),
        Walker(still + 80, np.tile([2.0, -7.0], (len(still), 1))),
    ]
    cameras, rows = {}, []
    for eye, there in ((west, late), (east, early)):
        tracks, whose = seen(eye, there)
        first = 1 if eye is east else 3
        cameras[eye.name] = store(tmp_path / eye.name, eye, tracks, run=f"run-{eye.name}")
        rows += [(eye.name, track, who + first, 1.0) for track, who in whose.items()]
    known = Identities(*(np.array(column) for column in zip(*rows, strict=True)))
    write_site(tmp_path / "site", SiteFile(cameras), known, refined={}, pictures={})
    site = Site.open(tmp_path / "site")

    stood = search(site, "a person stands within 2 m of where another person stood").events
    assert {tuple(one.event.roles.values()) for one in stood} == {(3,)}
    (spot,) = stood[0].spots
    assert (stood[0].run.run, spot.run.run, spot.track) == ("run-west", "run-east", 1)
    assert spot.distance_m == pytest.approx(0.3, abs=0.15)
    assert spot.begin_s == pytest.approx(-east.placement.time_offset_s, abs=1.0)
    on_site = west.placement.points(np.array([spot.xy_m]))[0]
    np.testing.assert_allclose(on_site, [6.0, 0.0], atol=0.1)
    assert not stood[0].about_spots[0].startswith("who was where")

    parked = search(site, "a person stands where a vehicle was parked")
    assert {tuple(one.event.roles.values()) for one in parked.events} == {(4,)}
    assert parked.events[0].spots[0].run.camera == "east"
    assert not any("same camera" in note for note in parked.asked.notes)
    # Each camera alone knows nothing of the other.
    assert not search(
        site.scene("west"), "a person stands within 2 m of where another stood"
    ).events
    with_boxes = search(site, "a person disappears within 2 m of where another person stood")
    assert any("same camera" in note for note in with_boxes.asked.notes)
