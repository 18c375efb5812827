"""Words in, events out: on scenes in which it is known what happens."""

import json
import re
import shutil
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyarrow
import pytest

import finding_scenes as scenes
from actev_rules import faults
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError, OutputError
from scene4d.core.files import read_json
from scene4d.core.progress import Silent
from scene4d.core.tracks import Tracks
from scene4d.searching import (
    Asked,
    SearchOptions,
    SearchResult,
    answer,
    search,
    understand,
    understand_all,
)
from scene4d.searching._asking import EVERYTHING, reaches
from scene4d.searching._entry import lean_tracks, staged_run
from scene4d.searching._places import Places
from scene4d.searching.activities import _casting as casting
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.activities.search import find
from scene4d.searching.exporting import actev_files, exported
from scene4d.searching.language import Query, Window
from scene4d.searching.result import clip_time
from scene4d.searching.stages import stage_of, thinned
from scene4d.store.footage import NoFootage, footage_of
from scene4d.store.query import Scene
from scene4d.store.runs import Run
from type_checks import unchecked

START = datetime(2026, 11, 20, 8, 0, 0, tzinfo=UTC)
ENTERS = "person enters vehicle"


@pytest.fixture(scope="module")
def gate(tmp_path_factory) -> Scene:
    folder = tmp_path_factory.mktemp("gate") / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    return Scene.open(scenes.write_scene(folder, everybody, start=START))


@pytest.fixture(scope="module")
def footage(tmp_path_factory) -> Path:
    return scenes.write_footage(tmp_path_factory.mktemp("footage") / "gate.avi")


def asked(scene: Scene, words: str, **options) -> Asked:
    return understand(scene, words, SearchOptions(**options))


def answer_silently(one: Asked) -> SearchResult:
    return answer(one, Silent())


def test_who_enters_the_car_is_found_once_where_and_when_it_is(gate):
    done = search(gate, ENTERS)
    assert len(done.events) == 1
    one = done.events[0].to_dict()
    assert one["roles"] == {"person": scenes.PERSON, "vehicle": scenes.PARKED}
    assert one["camera"] == "gate"
    # Getting in goes on for 1.5 s after he was last seen.
    assert one["end_s"] == pytest.approx(scenes.ENTERED_S + 1.5, abs=0.5)
    assert 7.0 <= one["begin_s"] < one["end_s"]
    assert one["score"] > 0.2
    assert one["begin_frame"] == round(one["begin_s"] * 10)
    assert one["end_frame"] == round(one["end_s"] * 10)


def test_json_has_the_promised_keys_and_only_these(gate):
    done = search(gate, ENTERS).to_dict()
    assert set(done) == {"query", "predicates", "events"}
    (one,) = done["events"]
    assert set(one) == {
        "activity", "score", "probability", "begin_s", "end_s", "begin_time", "end_time",
        "begin_frame", "end_frame", "camera", "run", "clip", "roles", "why", "notes",
    }  # fmt: skip
    assert done["query"] == ENTERS
    assert any(line.startswith("near(person, vehicle") for line in done["predicates"])
    assert np.prod(list(one["why"].values())) == pytest.approx(one["score"], rel=1e-6)
    assert (one["run"], one["clip"]) == ("morning", "morning")
    json.dumps(done, allow_nan=False)


def test_where_no_score_is_calibrated_it_says_so_and_gives_none(gate):
    # Entering is calibrated on annotated tracks, and not on a detector's.
    for words in ("person moves", ENTERS):
        for one in search(gate, words).to_dict()["events"]:
            assert one["probability"] is None
            assert one["notes"][0].startswith("probability: unknown")
        said = f"min_probability: the scores of '{words}' are not calibrated on .*detected"
        with pytest.raises(InputError, match=said):
            search(gate, words, min_probability=0.5)
    with pytest.raises(InputError, match="between 0 and 1"):
        SearchOptions(min_probability=1.2)


def test_min_probability_keeps_the_probable(gate):
    words = "person enters scene through structure"
    events = search(gate, words).events
    stated = [one.event.probability for one in events]
    for one in events:
        known = one.event.calibration
        assert one.event.probability == float(known.at(np.array(one.event.score)))
        assert one.to_dict()["notes"] == [known.note] and "simulated detector" in known.note
    assert len(stated) == 4 and 0.01 < min(stated) < 0.5
    for least, kept in ((min(stated) - 1e-6, 4), (max(stated) + 1e-3, 0), (1.0, 0)):
        assert len(search(gate, words, min_probability=least).events) == kept, least


def test_several_searches_at_once(gate, tmp_path):
    two = understand_all(gate, f"{ENTERS}; two people meet;", SearchOptions())
    assert [one.query.text for one in two] == [ENTERS, "two people meet"]
    assert [one.to_dict() for one in map(answer_silently, two)] == [
        search(gate, words).to_dict() for words in (ENTERS, "two people meet")
    ]
    with unchecked():  # sixty searches are read
        everything = understand_all(gate, EVERYTHING, SearchOptions())
    names = {one.query.activity.name for one in everything}
    assert {"person_enters_vehicle", "vehicle_stops", "people_meet"} <= names
    assert "person_enters_through_zone" not in names  # no zone is named
    people = scenes.write_scene(tmp_path / "people", scenes.people())
    with unchecked():
        alone = understand_all(Scene.open(people), EVERYTHING, SearchOptions())
    assert all("vehicle" not in one.query.activity.name for one in alone)
    with pytest.raises(InputError, match="nonsense"):
        understand_all(gate, f"{ENTERS}; nonsense", SearchOptions())


def test_times_of_day_are_iso_8601_where_the_start_is_known(gate, tmp_path):
    one = search(gate, ENTERS).events[0].to_dict()
    for end in ("begin", "end"):
        assert one[f"{end}_time"].endswith("Z")
        since = (datetime.fromisoformat(one[f"{end}_time"]) - START).total_seconds()
        assert since == pytest.approx(one[f"{end}_s"], abs=1e-3)
    scene = scenes.write_scene(tmp_path / "scene", [*scenes.people(), scenes.parked()])
    unknown = search(scene, ENTERS).events[0].to_dict()
    assert unknown["begin_time"] is None
    assert unknown["end_time"] is None


def test_one_search_takes_a_path_a_scene_or_several(tmp_path):
    north = scenes.write_scene(tmp_path / "a", scenes.people(), run="a", camera="north")
    south = scenes.write_scene(tmp_path / "b", scenes.people(), run="b", camera="south")

    def tracks(scene):
        done = search(scene, "two people meet", min_score=0.2)
        return [(one.run.run, set(one.event.roles.values())) for one in done.events]

    alone = tracks(str(north))
    assert alone == [("a", {scenes.ONE, scenes.OTHER})]
    assert tracks(north) == tracks(Scene.open(north)) == tracks([north]) == alone
    both = tracks([north, south])
    assert [run for run, _ in both] == ["a", "b"]
    assert tracks([Scene.open(north), south]) == tracks([north, Scene.open(south)]) == both
    assert both[1][1] == {10**9 + scenes.ONE, 10**9 + scenes.OTHER}
    east = scenes.write_scene(tmp_path / "c", scenes.people(), run="c", camera="east")
    three = tracks([Scene.open(north, south), east])
    assert three == tracks([north, south, east])
    assert three[2] == ("c", {2 * 10**9 + scenes.ONE, 2 * 10**9 + scenes.OTHER})
    with pytest.raises(InputError, match="no scene is given"):
        search([], "two people meet")
    with pytest.raises(InputError, match="named twice"):
        search([north, Scene.open(north)], "two people meet")


def test_options_may_come_in_one_or_by_their_names(gate):
    one = search(gate, "person moves", SearchOptions(min_score=0.4, top=1))
    other = search(gate, "person moves", min_score=0.4, top=1)
    assert one.asked.options == other.asked.options
    assert one.to_dict() == other.to_dict()
    with pytest.raises(TypeError, match="least"):
        search(gate, "person moves", least=0.4)


@pytest.mark.parametrize(
    ("options", "says"), [({"min_score": 1.5}, "min_score"), ({"top": 0}, "top")]
)
def test_options_that_cannot_be_are_refused_at_once(options, says):
    with pytest.raises(InputError, match=says):
        SearchOptions(**options)


def test_tables_have_a_row_per_event_and_a_column_per_role(gate):
    done = search(gate, "two people meet", min_score=0.01)
    rows = done.to_dict()["events"]
    assert len(rows) == len(done) > 0
    frame = done.to_pandas()
    roles = [role.name for role in done.asked.query.activity.roles]
    for role in roles:
        assert frame[role].tolist() == [row["roles"][role] for row in rows]
    assert [json.loads(why) for why in frame["why"]] == [row["why"] for row in rows]
    table = pyarrow.table(done)
    assert table.column_names == list(frame.columns)
    assert table["begin_s"].to_pylist() == [row["begin_s"] for row in rows]
    assert table["begin_time"].to_pylist() == [row["begin_time"] for row in rows]
    none = search(gate, "two people meet", min_score=1.0)
    assert pyarrow.table(none).num_rows == len(none.to_pandas()) == 0


def test_notebooks_show_a_table_and_a_plan(gate, tmp_path):
    html = search(gate, ENTERS)._repr_html_()
    assert ENTERS in html
    assert f"<td>{scenes.PERSON}</td>" in html
    assert html.count("<svg xmlns") == 1
    assert "Nothing found" in search(gate, ENTERS, min_score=1.0)._repr_html_()


def test_what_cannot_be_judged_is_null(gate):
    done = search(gate, ENTERS)
    one = done.events[0]
    unknown = replace(one, event=replace(one.event, why={"p: arm_moving_up(person)": np.nan}))
    assert unknown.to_dict()["why"] == {"p: arm_moving_up(person)": None}


def test_two_people_meet_where_they_do(gate):
    best = search(gate, "two people meet").events[0].event
    assert set(best.roles.values()) == {scenes.ONE, scenes.OTHER}
    assert 16 <= best.begin_s < 22 < best.end_s <= 28


def test_events_are_ordered_and_all_above_the_least(gate):
    some = search(gate, "person moves", min_score=0.3).events
    assert len(some) >= 3
    scores = [one.event.score for one in some]
    assert scores == sorted(scores, reverse=True)
    assert min(scores) >= 0.3
    fewer = search(gate, "person moves", min_score=scores[1] - 1e-9).events
    # The last digits differ with what is left out on the way.
    kept = [one for one in some if one.event.score >= scores[1] - 1e-9]
    assert [one.event.roles for one in fewer] == [one.event.roles for one in kept]


def test_only_the_best_know_what_was_around_them(gate):
    done = search(gate, "person moves", top=2)
    done.explain()
    assert [one.around is not None for one in done.events] == [True] * 2 + [False] * (
        len(done.events) - 2
    )
    for one in done.events[:2]:
        assert one.around.time_s.min() >= one.event.begin_s - 4.0 - 1e-9
        assert set(one.event.roles.values()) <= set(one.around.track.tolist())


def test_the_lean_rows_are_those_of_the_scene(gate):
    groups = {"velocity", "heading", "box"}
    lean, step_s = lean_tracks(gate, 0.01, groups)
    full = gate.tracks()
    assert step_s == pytest.approx(np.median(np.diff(np.unique(full.time_s))))
    always = {"track", "class_name", "time_s", "frame", "xy_m", "covariance_m2", "observed"}
    for name in full.array_names():
        if name in always or name.split("_")[0] in groups:
            np.testing.assert_array_equal(getattr(lean, name), getattr(full, name), err_msg=name)


def test_lean_rows_are_thinned_as_whole_ones(gate):
    (lean, step_s), (full, expected) = lean_tracks(gate, 0.5, {"box"}), thinned(gate.tracks(), 0.5)
    assert step_s == expected
    assert 0 < len(lean) < len(gate)
    for name in ("track", "time_s", "frame", "xy_m", "box_xyxy", "class_name", "observed"):
        np.testing.assert_array_equal(getattr(lean, name), getattr(full, name), err_msg=name)


def test_nothing_is_missed_for_the_lean_rows(gate):
    """The same events as of everything that the scene holds, for every activity."""
    calibration = Calibration.load(gate.camera_file("gate"))
    whole = stage_of(gate.tracks(), calibration)
    ready = asked(gate, ENTERS)
    for activity in load_catalogue().values():
        terms = [term for phase in activity.phases for term in phase.terms]
        if any("zone" in term.parameters for term in terms):
            continue
        query = replace(ready.query, activity=activity)
        lean = staged_run(replace(ready, query=query), gate.runs[0], calibration)
        assert find(lean, activity) == find(whole, activity), activity.name


def test_unknown_places_and_boxes_come_as_nan(tmp_path):
    rows = scenes.people()[1]
    rows = replace(
        rows,
        xy_m=np.where(np.arange(len(rows))[:, None] == 3, np.nan, rows.xy_m),
        box_xyxy=np.where(np.arange(len(rows))[:, None] == 5, np.nan, rows.box_xyxy),
    )
    lean, _ = lean_tracks(
        Scene.open(scenes.write_scene(tmp_path / "scene", [rows])), 0.01, {"velocity", "box"}
    )
    assert np.flatnonzero(np.isnan(lean.xy_m[:, 0])).tolist() == [3]
    assert np.flatnonzero(np.isnan(lean.box_xyxy[:, 2])).tolist() == [5]


def test_runs_are_searched_apart_and_ranked_together(tmp_path):
    folder = tmp_path / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    vague = [replace(rows, covariance_m2=30 * rows.covariance_m2) for rows in everybody]
    scenes.write_scene(folder, vague, run="first")
    scenes.write_scene(folder, everybody, run="second")
    scenes.write_scene(folder, scenes.people()[:1], run="third")
    done = search(Scene.open(folder), ENTERS, top=1)
    assert [one.run.run for one in done.events] == ["second", "first"]
    done.explain()
    assert [one.around is not None for one in done.events] == [True, False]
    assert done.events[0].event.score > done.events[1].event.score
    assert [run.run for run in done.runs] == ["first", "second"]  # the third has no vehicle
    base = done.events[0].run.track_base
    assert done.events[0].event.roles["person"] == base + scenes.PERSON
    assert base > 0


def test_tracks_drawn_twice_are_one_in_annotations(tmp_path):
    twin = replace(scenes.people()[0], track=np.full(len(scenes.people()[0]), 77))
    everybody = [*scenes.people(), twin, scenes.parked()]
    drawn = scenes.write_scene(
        tmp_path / "drawn", everybody, provenance={"annotations": "day.geom.yml"}
    )
    seen = scenes.write_scene(tmp_path / "seen", everybody, provenance={"source": "day.mp4"})
    assert len(search(Scene.open(drawn), ENTERS).events) == 1
    assert len(search(Scene.open(seen), ENTERS).events) == 2


def test_nothing_found_says_how_much_was_looked_at(tmp_path):
    folder = scenes.write_scene(tmp_path / "scene", [scenes.people()[1], scenes.parked()])
    done = search(Scene.open(folder), ENTERS, min_score=0.9)
    assert done.events == []
    assert done.verdict == (
        f"Nothing found in 1 clip of 1 camera: of {done.candidates} candidate "
        f"pair{'' if done.candidates == 1 else 's'} (person, vehicle) none scores 0.9 or more."
    )
    any_at_all = search(Scene.open(folder), ENTERS, min_score=0.0)
    assert any_at_all.events == []
    assert "none scores 0.001 or more" in any_at_all.verdict
    near = scenes.write_scene(tmp_path / "near", [scenes.people()[0], scenes.parked()])
    assert search(Scene.open(near), ENTERS, min_score=1.0).candidates >= 1


@pytest.mark.parametrize("least", [0.05, 1.0])
def test_a_run_is_cast_once_whether_anything_is_found_or_not(gate, monkeypatch, least):
    made = []

    def counting(*arguments):
        made.append(arguments)
        return casting.cast(*arguments)

    monkeypatch.setattr("scene4d.searching.activities.search.cast", counting)
    assert bool(search(gate, ENTERS, min_score=least).events) == (least < 1)
    assert len(made) == 1


def test_a_class_never_seen_is_an_error_that_says_what_is_there(tmp_path):
    folder = scenes.write_scene(tmp_path / "scene", scenes.people())
    with pytest.raises(InputError, match=r"has no car or .*'vehicle'.*there: person \(\d+ rows\)"):
        asked(Scene.open(folder), ENTERS)


def test_an_empty_scene_is_an_error(tmp_path):
    nobody = scenes.people()[0].select(np.zeros(50, bool))
    folder = scenes.write_scene(tmp_path / "scene", [nobody])
    with pytest.raises(InputError, match="empty"):
        Scene.open(folder)


def test_unknown_words_name_the_nearest(gate):
    with pytest.raises(InputError, match="vehicle"):
        asked(gate, "person enters vehicel")


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ("person enters vehicle between 08:00 and 08:01", 1),
        ("person enters vehicle after 9 am", 0),
        ("person enters vehicle between 23:00 and 07:00", 0),
    ],
)
def test_times_of_day(gate, words, count):
    done = search(gate, words)
    assert len(done.events) == count
    assert len(done.runs) == count  # what lies outside is not even read
    assert any("UTC" in note for note in done.asked.notes)


def test_a_time_of_day_needs_to_know_when_footage_began(tmp_path):
    folder = tmp_path / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    scenes.write_scene(folder, everybody, run="unknown")
    words = "person enters vehicle between 08:00 and 09:00"
    with pytest.raises(InputError, match="track it again with its start"):
        asked(Scene.open(folder), words)
    scenes.write_scene(folder, everybody, run="known", start=START)
    done = search(Scene.open(folder), words)
    assert [one.run.run for one in done.events] == ["known"]
    assert any("1 of 2 clips are left out" in note for note in done.asked.notes)


@pytest.mark.parametrize(
    ("begin", "end", "expected"),
    [
        (8 * 3600 + 5, 9 * 3600, True),
        (7 * 3600, 8 * 3600 + 1, True),
        (7 * 3600, 8 * 3600, False),
        (8 * 3600 + 31, 9 * 3600, False),
        (22 * 3600, 9 * 3600, True),
    ],
)
def test_which_runs_a_window_reaches(gate, begin, end, expected):
    assert reaches(gate.runs[0], Window(float(begin), float(end))) is expected


def test_zones_are_those_of_the_file(gate, tmp_path):
    around_car = [[-3, 13], [3, 13], [3, 19], [-3, 19]]
    far = [[-30, 40], [-20, 40], [-20, 50], [-30, 50]]
    path = tmp_path / "places.json"
    path.write_text(json.dumps({"zones": {"bay": around_car, "field": far}}))
    bay = search(gate, "person in zone bay", zones=path, min_score=0.3).events
    assert {one.event.roles["person"] for one in bay} == {scenes.PERSON}
    assert search(gate, "person in zone field", zones=path, min_score=0.3).events == []
    with pytest.raises(InputError):
        asked(gate, "person in zone bey", zones=path)


def test_a_zone_of_the_catalogue_that_nobody_named(gate):
    with pytest.raises(InputError, match="pass it as zones"):
        asked(gate, "person leaves through door")


def test_a_place_of_one_camera_is_looked_for_there_alone(tmp_path):
    folder = tmp_path / "scene"
    scenes.write_scene(folder, scenes.people(), camera="gate", run="a")
    scenes.write_scene(folder, scenes.people(), camera="yard", run="b")
    corners = [[-3, 13], [3, 13], [3, 19], [-3, 19]]
    path = tmp_path / "places.json"
    path.write_text(json.dumps({"zones": {"bay": {"camera": "yard", "points": corners}}}))
    one = search(Scene.open(folder), "person in zone bay", zones=path, min_score=0.3)
    assert {event.run.camera for event in one.events} == {"yard"}
    path.write_text(json.dumps({"zones": {"bay": corners}}))
    both = search(Scene.open(folder), "person in zone bay", zones=path, min_score=0.3)
    assert {event.run.camera for event in both.events} == {"gate", "yard"}
    assert any("each of 2 cameras" in note for note in both.asked.notes)


def test_an_activity_of_ones_own(gate, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "activities:\n  person_lurks:\n    phrases: [person lurks]\n    roles: {person: person}\n"
        '    phases:\n      - {name: lurks, lasts: [3, 60], holds: ["stationary(person)"]}\n'
    )
    done = search(gate, "person lurks", catalogues=[path])
    assert {one.event.roles["person"] for one in done.events} == {scenes.ONE, scenes.OTHER}


def test_the_same_run_in_two_scenes_is_refused(tmp_path):
    first = scenes.write_scene(tmp_path / "a", scenes.people())
    second = Path(shutil.copytree(first, tmp_path / "b"))
    with pytest.raises(InputError, match="two of the scenes"):
        search(Scene.open(first, second), "person moves")


def test_keypoints_are_brought_where_they_are_asked_for(tmp_path):
    rows = scenes.people()[2]
    rows = replace(
        rows, keypoint_uv=np.ones((len(rows), 26, 2)), keypoint_score=np.ones((len(rows), 26))
    )
    scene = Scene.open(scenes.write_scene(tmp_path / "scene", [rows]))
    calibration = Calibration.load(scene.camera_file("gate"))
    with_them = staged_run(asked(scene, "person raises arm"), scene.runs[0], calibration)
    assert with_them.tracks.keypoint_uv.shape[1] == 26
    done = search(scene, "person raises arm", min_score=0.001)
    assert done.rows == len(with_them.tracks)


def test_people_are_found_by_their_height(tmp_path):
    """Sizes are brought where they are asked for."""
    rows = [
        replace(one, size_m=np.tile([np.nan, np.nan, height_m], (len(one), 1)),
                size_sigma_m=np.tile([np.nan, np.nan, 0.05], (len(one), 1)))
        for one, height_m in zip(scenes.people()[:2], (1.25, 1.80), strict=True)
    ]  # fmt: skip
    scene = Scene.open(scenes.write_scene(tmp_path / "scene", rows))
    path = tmp_path / "mine.yaml"
    path.write_text(
        "activities:\n  child_lurks:\n    phrases: [person lurks]\n    roles: {person: person}\n"
        "    phases:\n      - {name: is, lasts: [1, 60], "
        "holds: ['not taller_than(person, height_m=1.5)']}\n"
    )
    done = search(scene, "person lurks", catalogues=[path])
    (event,) = done.events
    assert set(event.event.roles.values()) == set(rows[0].track) and event.event.score > 0.99


def written(scene, out, words=ENTERS, **options):
    search(scene, words, **{"top": 3, **options}).save(out, command="scene4d search")
    return (out / "search.html").read_text()


def test_the_page_without_footage_says_so_and_where_to_get_it(gate, tmp_path):
    html = written(gate, tmp_path)
    assert "No pictures. The scene does not say what footage it was made of." in html
    assert "<video" not in html
    assert html.count("<svg xmlns") == 1
    assert '<pre class="understood" tabindex="0"' in html
    assert sorted(path.name for path in tmp_path.iterdir()) == ["events.json", "search.html"]


def test_all_events_stand_beside_the_page_as_json_prints_them(gate, tmp_path):
    done = search(gate, "person moves", top=1)
    done.save(tmp_path / "new" / "folder")
    values = read_json(tmp_path / "new" / "folder" / "events.json")
    assert len(values["events"]) > 1
    assert values == {
        "schema": "scene4d/search/1",
        "version": version("scene4d"),
        "warnings": list(done.asked.notes),
        "error": None,
        **done.to_dict(),
    }


def test_the_page_has_clips_where_footage_is_given(gate, tmp_path, footage):
    html = written(gate, tmp_path / "..", words="person moves", top=2, footage=footage)
    assert "The 2 best are shown." in html
    assert html.count("<video") == 2
    assert html.count("data:video/mp4;base64,") == 2
    assert html.count("<svg xmlns") == 2
    assert not re.search(r'(src|href)="(?!data:|#)', html)


def test_the_page_finds_the_footage_of_the_run(tmp_path, footage):
    footage = Path(shutil.copy(footage, tmp_path / "own.avi"))
    folder = scenes.write_scene(
        tmp_path / "scene", [*scenes.people(), scenes.parked()], provenance={"source": str(footage)}
    )
    assert "<video" in written(Scene.open(folder), tmp_path / "out")
    footage.unlink()
    html = written(Scene.open(folder), tmp_path / "out")
    assert f"no longer at {footage}. Pass footage: the file, or the folder, where" in html


def test_footage_that_is_not_there_is_an_error_before_anything_is_done(gate, tmp_path):
    with pytest.raises(InputError, match=r"footage: .*gone\.mp4 does not exist"):
        written(gate, tmp_path, footage=tmp_path / "gone.mp4")
    assert not (tmp_path / "search.html").exists()


def test_footage_that_cannot_be_read_is_told_on_the_page(gate, tmp_path):
    broken = tmp_path / "broken.mp4"
    broken.write_text("no video")
    assert "cannot be shown" in written(gate, tmp_path, footage=broken)


def test_an_earlier_page_survives_a_failure(gate, tmp_path, monkeypatch):
    (tmp_path / "search.html").write_text("earlier")

    def fail(*_):
        raise OutputError("full")

    monkeypatch.setattr("scene4d.searching.pages._page.search_html", fail)
    with pytest.raises(OutputError):
        written(gate, tmp_path)
    assert (tmp_path / "search.html").read_text() == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["search.html"]


def run_of(source: str | None, kind: str = "source", **more: str):
    said = more if source is None else {kind: source, **more}
    return Run("r", "c", 0, False, 0, 0, 1, {"person": 1}, (), "scene4d", said)


def test_where_footage_is_looked_for(tmp_path):
    clip = tmp_path / "2018.G328.r13.avi"
    clip.touch()
    (tmp_path / "2018.G328.geom.yml").touch()
    drawn = run_of("/elsewhere/2018.G328.geom.yml", "annotations")
    assert footage_of(drawn, tmp_path, alone=False) == clip
    assert isinstance(footage_of(drawn, None, alone=True), NoFootage)
    assert footage_of(run_of("/elsewhere/2018.G328.r13.avi"), tmp_path, alone=False) == clip
    assert isinstance(footage_of(run_of("/elsewhere/other.avi"), tmp_path, alone=False), NoFootage)
    assert footage_of(run_of("/elsewhere/other.avi"), clip, alone=True) == clip
    assert isinstance(footage_of(run_of("/elsewhere/other.avi"), clip, alone=False), NoFootage)
    assert footage_of(run_of(None), clip, alone=True) == clip
    assert isinstance(footage_of(run_of(None), clip, alone=False), NoFootage)
    assert isinstance(footage_of(run_of(None), tmp_path, alone=True), NoFootage)
    both = run_of(str(clip), annotations="/elsewhere/2018.G328.geom.yml")
    assert footage_of(both, None, alone=False) == clip
    assert "stream" in footage_of(run_of("rtsp://gate/1"), None, alone=True).reason


def test_actev_names_every_clip_and_every_event(tmp_path):
    folder = tmp_path / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    scenes.write_scene(folder, everybody, run="a", provenance={"source": "/x/gate one.avi"})
    scenes.write_scene(folder, everybody, run="b", provenance={"annotations": "/x/b.geom.yml"})
    nobody = {"source": "/x/nobody.avi"}
    scenes.write_scene(folder, scenes.people()[1:2], run="c", provenance=nobody)
    done = search(folder, ENTERS)
    assert [run.run for run in done.runs] == ["a", "b"]  # the third has no vehicle
    values = json.loads(exported([done], "actev"))
    assert values["filesProcessed"] == ["gate_one.avi", "b", "nobody.avi"]
    assert set(values["processingReport"]["fileStatuses"]) == set(values["filesProcessed"])
    assert [one["activity"] for one in values["activities"]] == ["person_enters_vehicle"] * 2
    one, event = values["activities"][0], done.events[0]
    (signal,) = one["localization"].values()
    assert signal == {str(event.begin_frame): 1, str(event.end_frame + 1): 0}
    assert one["presenceConf"] == event.event.score


def test_actev_holds_several_activities_in_one_file(tmp_path):
    everybody = [*scenes.people(), scenes.parked()]
    scene = scenes.write_scene(tmp_path / "scene", everybody, run="a")
    with unchecked():
        asked = understand_all(Scene.open(scene), EVERYTHING, SearchOptions())
    first, *others = map(answer_silently, asked)
    values = json.loads(exported([first, *others], "actev"))
    assert faults(values) == []
    assert values["filesProcessed"] == ["a"]
    found = Counter(one["activity"] for one in values["activities"])
    assert found["person_enters_vehicle"] == 1
    assert found["people_meet"] >= 1
    assert sum(found.values()) == sum(len(one.events) for one in (first, *others))


def test_two_clips_of_one_name_keep_apart():
    first, second = run_of("/a/x.avi"), run_of("/b/x.avi")
    names = actev_files([replace(first, run="one"), replace(second, run="two")])
    assert names == {"one": "one", "two": "two"}


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "00:00.0"), (59.96, "01:00.0"), (61.25, "01:01.2"), (3723.4, "1:02:03.4")],
)
def test_times_of_clips(seconds, text):
    assert clip_time(seconds) == text


def test_three_roles_are_groups(gate):
    roles = tuple(Role(name, ("person",)) for name in "abc")
    terms = (Term("near", ("a", "b")), Term("near", ("b", "c")))
    activity = Activity("x", roles, (Phase("p", terms),))
    query = Query("x", activity, [], None, [])
    done = SearchResult(Asked(gate, query, SearchOptions(), Places(), ()))
    assert "0 candidate groups (a, b, c)" in done.verdict


def test_rows_need_no_order_in_the_files(tmp_path):
    rows = Tracks.concatenate([*scenes.people(), scenes.parked()])
    shuffled = rows.select(np.random.default_rng(0).permutation(len(rows)))
    folder = scenes.write_scene(tmp_path / "scene", [shuffled])
    lean, _ = lean_tracks(Scene.open(folder), 0.2, {"velocity"})
    assert (np.lexsort([lean.time_s, lean.track]) == np.arange(len(lean))).all()


def test_nobody_is_searched_for_only_while_the_camera_was_watched(gate, tmp_path):
    places = tmp_path / "places.json"
    places.write_text(json.dumps({"zones": {"lane": [[-3, 7], [3, 7], [3, 10], [-3, 10]]}}))
    words = "nobody is in zone lane for 1 second"
    with pytest.raises(InputError, match="when its camera was watched"):
        asked(gate, words, zones=places)
    # Somebody passes from 2 to 6 s; from 10 to 20 s nothing was looked at.
    watched = (*np.arange(0, 10.05, 0.1), *np.arange(20, 30.05, 0.1))
    folder = scenes.write_scene(
        tmp_path / "scene", [scenes.people()[1]], start=START, watched_s=watched
    )
    scenes.write_scene(tmp_path / "scene", [scenes.parked()], run="old", start=START)
    scene = Scene.open(folder)
    assert [run.watched is None for run in scene.runs] == [False, True]
    done = search(scene, words, zones=places)
    found = sorted((e.event.begin_s, e.event.end_s) for e in done.events)
    assert found == [
        pytest.approx((0.0, 2.0), abs=0.7),
        pytest.approx((6.0, 10.0), abs=0.7),
        pytest.approx((20.0, 30.0), abs=0.3),
    ]
    assert any("1 of 2 clips are left out" in note for note in done.asked.notes)
    late = next(e.to_dict() for e in done.events if e.event.begin_s > 15)
    assert (late["roles"], late["begin_frame"], late["probability"]) == ({}, 200, None)
    assert "nobody" in done.to_pandas().columns
    assert ">lane</text>" in done._repr_html_()
    evening = search(scene, f"{words} after 8:00:25", zones=places)
    assert [e.event.begin_s for e in evening.events] == [pytest.approx(25.0, abs=0.3)]
    both = search(scene, "a person walks or a vehicle stops", zones=places)
    assert {e.event.activity for e in both.events} == {"a person walks"}
