"""Words in, events out: on scenes in which it is known what happens."""

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import finding_scenes as scenes
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError, OutputError
from scene4d.core.files import read_json
from scene4d.core.progress import Silent
from scene4d.core.tracks import Tracks
from scene4d.searching import Asked, Search, search, understand
from scene4d.searching.actev import actev_files, write_actev
from scene4d.searching.activities import casting
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.activities.search import find
from scene4d.searching.clock import reaches
from scene4d.searching.footage import NoFootage, footage_of
from scene4d.searching.language import Query, Window
from scene4d.searching.loading import lean_tracks, staged_run
from scene4d.searching.places import Places
from scene4d.searching.stages import stage_of
from scene4d.searching.stages.staging import thinned
from scene4d.searching.telling import clip_time, verdict
from scene4d.searching.writing import write_search
from scene4d.store.query import Scene

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


def found(scene: Scene, words: str, **options):
    asking = {key: options.pop(key) for key in ("catalogues", "zones") if key in options}
    return search(scene, understand(scene, words, **asking), **options)


def test_who_enters_the_car_is_found_once_where_and_when_it_is(gate):
    done = found(gate, ENTERS)
    assert len(done.events) == 1
    one = done.events[0].to_dict()
    assert one["roles"] == {"person": scenes.PERSON, "vehicle": scenes.PARKED}
    assert one["camera"] == "gate"
    assert one["end_s"] == pytest.approx(scenes.ENTERED_S, abs=0.5)
    assert 7.0 <= one["begin_s"] < one["end_s"]
    assert one["score"] > 0.2
    assert one["begin_frame"] == round(one["begin_s"] * 10)
    assert one["end_frame"] == round(one["end_s"] * 10)


def test_json_has_the_promised_keys_and_only_these(gate):
    done = found(gate, ENTERS).to_dict()
    assert set(done) == {"query", "predicates", "events"}
    assert set(done["events"][0]) == {
        "activity", "score", "begin_s", "end_s", "begin_frame", "end_frame", "camera", "roles",
        "why",
    }  # fmt: skip
    assert done["query"] == ENTERS
    assert any(line.startswith("near(person, vehicle") for line in done["predicates"])
    why = done["events"][0]["why"]
    assert np.prod(list(why.values())) == pytest.approx(done["events"][0]["score"], rel=1e-6)
    json.dumps(done, allow_nan=False)


def test_what_cannot_be_judged_is_null(gate):
    done = found(gate, ENTERS)
    one = done.events[0]
    unknown = replace(one, event=replace(one.event, why={"p: arm_moving_up(person)": np.nan}))
    assert unknown.to_dict()["why"] == {"p: arm_moving_up(person)": None}


def test_two_people_meet_where_they_do(gate):
    best = found(gate, "two people meet").events[0].event
    assert set(best.roles.values()) == {scenes.ONE, scenes.OTHER}
    assert 16 <= best.begin_s < 22 < best.end_s <= 28


def test_events_are_ordered_and_all_above_the_least(gate):
    some = found(gate, "person moves", min_score=0.3).events
    assert len(some) >= 3
    scores = [one.event.score for one in some]
    assert scores == sorted(scores, reverse=True)
    assert min(scores) >= 0.3
    fewer = found(gate, "person moves", min_score=scores[1] - 1e-9).events
    # The last digits differ with what is left out on the way.
    kept = [one for one in some if one.event.score >= scores[1] - 1e-9]
    assert [one.event.roles for one in fewer] == [one.event.roles for one in kept]


def test_only_the_best_know_what_was_around_them(gate):
    done = found(gate, "person moves", keep=2)
    assert [one.around is not None for one in done.events] == [True] * 2 + [False] * (
        len(done.events) - 2
    )
    for one in done.events[:2]:
        assert one.around.time_s.min() >= one.event.begin_s - 4.0 - 1e-9
        assert set(one.event.roles.values()) <= set(one.around.track.tolist())


def test_the_lean_rows_are_those_of_the_scene(gate):
    lean, step_s = lean_tracks(gate, 0.01)
    full = gate.tracks()
    assert step_s == pytest.approx(np.median(np.diff(np.unique(full.time_s))))
    for name in full.array_names():
        if name not in ("shared_covariance_m2", "score", "keypoint_uv", "keypoint_score"):
            np.testing.assert_array_equal(getattr(lean, name), getattr(full, name), err_msg=name)


def test_lean_rows_are_thinned_as_whole_ones(gate):
    (lean, step_s), (full, expected) = lean_tracks(gate, 0.5), thinned(gate.tracks(), 0.5)
    assert step_s == expected
    assert 0 < len(lean) < len(gate)
    for name in ("track", "time_s", "frame", "xy_m", "box_xyxy", "class_name", "observed"):
        np.testing.assert_array_equal(getattr(lean, name), getattr(full, name), err_msg=name)


def test_nothing_is_missed_for_the_lean_rows(gate):
    """The same events as of everything that the scene holds, for every activity."""
    calibration = Calibration.load(gate.camera_file("gate"))
    whole = stage_of(gate.tracks(), calibration)
    lean = staged_run(gate, gate.runs[0], calibration, Places(), with_keypoints=False)
    for activity in load_catalogue().values():
        terms = [term for phase in activity.phases for term in phase.terms]
        if any("zone" in term.parameters for term in terms):
            continue
        assert find(lean.stage, activity) == find(whole, activity), activity.name


def test_unknown_places_and_boxes_come_as_nan(tmp_path):
    rows = scenes.people()[1]
    rows = replace(
        rows,
        xy_m=np.where(np.arange(len(rows))[:, None] == 3, np.nan, rows.xy_m),
        box_xyxy=np.where(np.arange(len(rows))[:, None] == 5, np.nan, rows.box_xyxy),
    )
    lean, _ = lean_tracks(Scene.open(scenes.write_scene(tmp_path / "scene", [rows])), 0.01)
    assert np.flatnonzero(np.isnan(lean.xy_m[:, 0])).tolist() == [3]
    assert np.flatnonzero(np.isnan(lean.box_xyxy[:, 2])).tolist() == [5]


def test_runs_are_searched_apart_and_ranked_together(tmp_path):
    folder = tmp_path / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    vague = [replace(rows, covariance_m2=30 * rows.covariance_m2) for rows in everybody]
    scenes.write_scene(folder, vague, run="first")
    scenes.write_scene(folder, everybody, run="second")
    scenes.write_scene(folder, scenes.people()[:1], run="third")
    done = found(Scene.open(folder), ENTERS)
    assert [one.run.run for one in done.events] == ["second", "first"]
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
    assert len(found(Scene.open(drawn), ENTERS).events) == 1
    assert len(found(Scene.open(seen), ENTERS).events) == 2


def test_nothing_found_says_how_much_was_looked_at(tmp_path):
    folder = scenes.write_scene(tmp_path / "scene", [scenes.people()[1], scenes.parked()])
    done = found(Scene.open(folder), ENTERS, min_score=0.9)
    assert done.events == []
    assert verdict(done) == (
        f"Nothing found in 1 clip of 1 camera: of {done.candidates} candidate "
        f"pair{'' if done.candidates == 1 else 's'} (person, vehicle) none scores 0.9 or more."
    )
    any_at_all = found(Scene.open(folder), ENTERS, min_score=0.0)
    assert any_at_all.events == []
    assert "none scores 0.001 or more" in verdict(any_at_all)
    near = scenes.write_scene(tmp_path / "near", [scenes.people()[0], scenes.parked()])
    assert found(Scene.open(near), ENTERS, min_score=1.0).candidates >= 1


@pytest.mark.parametrize("least", [0.05, 1.0])
def test_a_run_is_cast_once_whether_anything_is_found_or_not(gate, monkeypatch, least):
    made = []
    original = casting._ordered

    def counting(*arguments):
        made.append(arguments)
        return original(*arguments)

    monkeypatch.setattr(casting, "_ordered", counting)
    assert bool(found(gate, ENTERS, min_score=least).events) == (least < 1)
    assert len(made) == 1


def test_a_class_never_seen_is_an_error_that_says_what_is_there(tmp_path):
    folder = scenes.write_scene(tmp_path / "scene", scenes.people())
    with pytest.raises(InputError, match=r"has no car or .*'vehicle'.*there: person \(\d+ rows\)"):
        understand(Scene.open(folder), ENTERS)


def test_an_empty_scene_is_an_error(tmp_path):
    nobody = scenes.people()[0].select(np.zeros(50, bool))
    folder = scenes.write_scene(tmp_path / "scene", [nobody])
    with pytest.raises(InputError, match="empty"):
        Scene.open(folder)


def test_unknown_words_name_the_nearest(gate):
    with pytest.raises(InputError, match="vehicle"):
        understand(gate, "person enters vehicel")


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ("person enters vehicle between 08:00 and 08:01", 1),
        ("person enters vehicle after 9 am", 0),
        ("person enters vehicle between 23:00 and 07:00", 0),
    ],
)
def test_times_of_day(gate, words, count):
    done = found(gate, words)
    assert len(done.events) == count
    assert len(done.runs) == count  # what lies outside is not even read
    assert any("UTC" in note for note in done.asked.notes)


def test_a_time_of_day_needs_to_know_when_footage_began(tmp_path):
    folder = tmp_path / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    scenes.write_scene(folder, everybody, run="unknown")
    words = "person enters vehicle between 08:00 and 09:00"
    with pytest.raises(InputError, match="--start"):
        understand(Scene.open(folder), words)
    scenes.write_scene(folder, everybody, run="known", start=START)
    done = found(Scene.open(folder), words)
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
    bay = found(gate, "person in zone bay", zones=path, min_score=0.3).events
    assert {one.event.roles["person"] for one in bay} == {scenes.PERSON}
    assert found(gate, "person in zone field", zones=path, min_score=0.3).events == []
    with pytest.raises(InputError):
        understand(gate, "person in zone bey", zones=path)


def test_a_zone_of_the_catalogue_that_nobody_named(gate):
    with pytest.raises(InputError, match="--zones"):
        understand(gate, "person leaves through door")


def test_a_place_of_one_camera_is_looked_for_there_alone(tmp_path):
    folder = tmp_path / "scene"
    scenes.write_scene(folder, scenes.people(), camera="gate", run="a")
    scenes.write_scene(folder, scenes.people(), camera="yard", run="b")
    corners = [[-3, 13], [3, 13], [3, 19], [-3, 19]]
    path = tmp_path / "places.json"
    path.write_text(json.dumps({"zones": {"bay": {"camera": "yard", "points": corners}}}))
    one = found(Scene.open(folder), "person in zone bay", zones=path, min_score=0.3)
    assert {event.run.camera for event in one.events} == {"yard"}
    path.write_text(json.dumps({"zones": {"bay": corners}}))
    both = found(Scene.open(folder), "person in zone bay", zones=path, min_score=0.3)
    assert {event.run.camera for event in both.events} == {"gate", "yard"}
    assert any("each of 2 cameras" in note for note in both.asked.notes)


def test_an_activity_of_ones_own(gate, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "activities:\n  person_lurks:\n    phrases: [person lurks]\n    roles: {person: person}\n"
        '    phases:\n      - {name: lurks, lasts: [3, 60], holds: ["stationary(person)"]}\n'
    )
    done = found(gate, "person lurks", catalogues=[path])
    assert {one.event.roles["person"] for one in done.events} == {scenes.ONE, scenes.OTHER}


def test_the_same_run_in_two_scenes_is_refused(tmp_path):
    first = scenes.write_scene(tmp_path / "a", scenes.people())
    second = Path(shutil.copytree(first, tmp_path / "b"))
    with pytest.raises(InputError, match="two of the scenes"):
        found(Scene.open(first, second), "person moves")


def test_keypoints_are_brought_where_they_are_asked_for(tmp_path):
    rows = scenes.people()[2]
    rows = replace(
        rows, keypoint_uv=np.ones((len(rows), 26, 2)), keypoint_score=np.ones((len(rows), 26))
    )
    scene = Scene.open(scenes.write_scene(tmp_path / "scene", [rows]))
    calibration = Calibration.load(scene.camera_file("gate"))
    with_them = staged_run(scene, scene.runs[0], calibration, Places(), with_keypoints=True)
    assert with_them.stage.tracks.keypoint_uv.shape[1] == 26
    done = found(scene, "person raises arm", min_score=0.001)
    assert done.rows == len(with_them.stage.tracks)


def written(scene, out, footage=None, words=ENTERS, top=3):
    done = found(scene, words, keep=top)
    write_search(done, scene, out, Silent(), top=top, footage=footage, command="scene4d search")
    return (out / "search.html").read_text()


def test_the_page_without_footage_says_so(gate, tmp_path):
    html = written(gate, tmp_path)
    assert "No pictures." in html
    assert "<video" not in html
    assert html.count('class="above"') == 1
    assert read_json(tmp_path / "events.json") == found(gate, ENTERS).to_dict()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["events.json", "search.html"]


def test_the_page_has_clips_where_footage_is_given(gate, tmp_path, footage):
    html = written(gate, tmp_path / "..", footage, words="person moves", top=2)
    assert "The 2 best are shown." in html
    assert html.count("<video") == 2
    assert html.count("data:video/mp4;base64,") == 2
    assert html.count('class="above"') == 2
    assert "http://" not in html
    assert "https://" not in html


def test_the_page_finds_the_footage_of_the_run(tmp_path, footage):
    footage = Path(shutil.copy(footage, tmp_path / "own.avi"))
    folder = scenes.write_scene(
        tmp_path / "scene", [*scenes.people(), scenes.parked()], provenance={"source": str(footage)}
    )
    (tmp_path / "out").mkdir()
    assert "<video" in written(Scene.open(folder), tmp_path / "out")
    footage.unlink()
    assert f"no longer at {footage}" in written(Scene.open(folder), tmp_path / "out")


def test_footage_that_is_not_there_is_an_error(gate, tmp_path):
    with pytest.raises(InputError, match="no such footage"):
        written(gate, tmp_path, tmp_path / "gone.mp4")
    assert not (tmp_path / "search.html").exists()


def test_footage_that_cannot_be_read_is_told_on_the_page(gate, tmp_path):
    broken = tmp_path / "broken.mp4"
    broken.write_text("no video")
    assert "cannot be shown" in written(gate, tmp_path, broken)


def test_an_earlier_page_survives_a_failure(gate, tmp_path, monkeypatch):
    (tmp_path / "search.html").write_text("earlier")

    def fail(*_):
        raise OutputError("full")

    monkeypatch.setattr("scene4d.searching.writing.search_html", fail)
    with pytest.raises(OutputError):
        written(gate, tmp_path)
    assert (tmp_path / "search.html").read_text() == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["search.html"]


def run_of(source: str | None, kind: str = "source"):
    from scene4d.store.runs import Run

    said = {} if source is None else {kind: source}
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
    assert "stream" in footage_of(run_of("rtsp://gate/1"), None, alone=True).reason


def test_actev_names_every_clip_and_every_event(tmp_path):
    folder = tmp_path / "scene"
    everybody = [*scenes.people(), scenes.parked()]
    scenes.write_scene(folder, everybody, run="a", provenance={"source": "/x/gate one.avi"})
    scenes.write_scene(folder, everybody, run="b", provenance={"annotations": "/x/b.geom.yml"})
    done = found(Scene.open(folder), ENTERS)
    write_actev(done, tmp_path / "out.json")
    values = read_json(tmp_path / "out.json")
    assert values["filesProcessed"] == ["gate_one.avi", "b"]
    assert [one["activity"] for one in values["activities"]] == ["person_enters_vehicle"] * 2
    one, event = values["activities"][0], done.events[0]
    (signal,) = one["localization"].values()
    assert signal == {str(event.begin_frame): 1, str(event.end_frame + 1): 0}
    assert one["presenceConf"] == event.event.score


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


def test_three_roles_are_groups():
    roles = tuple(Role(name, ("person",)) for name in "abc")
    terms = (Term("near", ("a", "b")), Term("near", ("b", "c")))
    activity = Activity("x", roles, (Phase("p", terms),))
    query = Query("x", activity, [], None, [])
    done = Search(Asked(query, Places(), ()), 0.5)
    assert "0 candidate groups (a, b, c)" in verdict(done)


def test_rows_need_no_order_in_the_files(tmp_path):
    rows = Tracks.concatenate([*scenes.people(), scenes.parked()])
    shuffled = rows.select(np.random.default_rng(0).permutation(len(rows)))
    folder = scenes.write_scene(tmp_path / "scene", [shuffled])
    lean, _ = lean_tracks(Scene.open(folder))
    assert (np.lexsort([lean.time_s, lean.track]) == np.arange(len(lean))).all()
