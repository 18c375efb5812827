"""Scores as probabilities: the file that is shipped, and how it is counted."""

import json
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from benchmarks import score_calibration as benchmark
from benchmarks.simulated_detector import ERRORS, SimulatedDetector
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.people import Detections
from scene4d.evaluation._options import TUNED
from scene4d.evaluation.measures._probability import reliability
from scene4d.searching.activities import calibrated
from scene4d.searching.activities.calibrated import ANNOTATED, DETECTED, calibration_of, fingerprint
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Relation, Role
from scene4d.searching.language import parse_query
from scene4d.store.log import Look

CATALOGUE = load_catalogue()
FILE = resources.files(calibrated.__package__).joinpath(calibrated.FILE)
TABLES = json.loads(FILE.read_text("utf-8"))
SHIPPED = [(tracks, name) for tracks in (ANNOTATED, DETECTED) for name in sorted(TABLES[tracks])]


@pytest.mark.parametrize(("tracks", "name"), SHIPPED)
def test_the_shipped_probabilities_belong_to_the_catalogue(tracks, name):
    """If not, the activity has changed: python -m benchmarks.score_calibration --write."""
    one = TABLES[tracks][name]
    assert one["fingerprint"] == fingerprint(CATALOGUE[name])
    assert tuple(one["cameras"]) == TUNED
    assert one["labels"] >= benchmark.LEAST_LABELS
    assert one["events"] > one["labels"]
    assert 0 < one["expected_error"] < 0.2
    assert one["brier_score"] < one["brier_score_of_share"]
    score, probability = np.array(one["score"]), np.array(one["probability"])
    assert (np.diff(score) > 0).all()
    assert (np.diff(probability) >= 0).all()
    assert benchmark.LIMIT <= probability[0] < probability[-1] <= 1 - benchmark.LIMIT


def test_words_that_are_an_activity_have_its_probabilities_and_others_none():
    for words in ("person enters vehicle", "someone gets into a car", "the truck turns left"):
        assert calibration_of(parse_query(words, CATALOGUE).activity, ANNOTATED), words
    for words in ("person near vehicle", "person enters vehicle and then vehicle starts"):
        activity = parse_query(words, CATALOGUE).activity
        assert not any(calibration_of(activity, tracks) for tracks in (ANNOTATED, DETECTED)), words
    either = parse_query("a car turns left or a truck turns left", CATALOGUE).activity
    own = calibration_of(CATALOGUE["vehicle_turns_left"], DETECTED)
    assert [one.name for one in either.options] == ["a car turns left", "a truck turns left"]
    assert all(calibration_of(one, DETECTED) is own for one in either.options)


def test_a_detectors_tracks_have_probabilities_of_their_own():
    """Fewer of its events of one score are right, and each says whose tracks it is of."""
    activity = CATALOGUE["vehicle_stops"]
    annotated, detected = (calibration_of(activity, tracks) for tracks in (ANNOTATED, DETECTED))
    assert detected.at(np.array(0.5)) < annotated.at(np.array(0.5)) - 0.05
    assert "simulated detector" in detected.note and "detector" not in annotated.note


def test_what_changes_scores_changes_the_fingerprint():
    one = CATALOGUE["person_enters_vehicle"]
    first, last = one.phases
    person, vehicle = one.roles
    same = replace(one, name="x", roles=(person, Role("vehicle", ("truck",))), labels=())
    assert fingerprint(same) == fingerprint(one)
    changed = [
        replace(one, phases=(replace(first, min_s=1.0), last)),
        replace(one, phases=(first, replace(last, gap_s=9.0))),
        replace(one, phases=(replace(first, terms=first.terms[1:]), last)),
        replace(one, phases=(last, first)),
        replace(one, relations=(Relation("stays", "before", "vanishes"),)),
        replace(one, roles=(replace(person, count=3), vehicle)),
    ]
    assert len({fingerprint(other) for other in [one, *changed]}) == len(changed) + 1


@given(st.floats(0.0, 1.0), st.sampled_from(SHIPPED))
def test_the_least_score_of_a_probability(probability, which):
    tracks, name = which
    known = calibration_of(CATALOGUE[name], tracks)
    least = known.least_score(probability)
    if np.isinf(least):
        assert known.probability[-1] < probability
        return
    assert known.at(np.array(least)) >= probability - 1e-9
    assert least <= known.score[0] or known.at(np.array(least - 1e-3)) <= probability + 1e-9


def drawn(rng: np.random.Generator, count: int, curve) -> tuple[np.ndarray, np.ndarray]:
    score = rng.beta(0.4, 0.8, count)
    return score, rng.random(count) < curve(score)


@pytest.mark.parametrize("curve", [lambda s: s**2, lambda s: 0.1 + 0.3 * s, lambda s: s**0.3])
def test_known_probabilities_are_found_again(curve):
    rng = np.random.default_rng(0)
    found = benchmark.calibrate([drawn(rng, 400, curve) for _ in range(2)])
    assert found["brier_score"] < found["brier_score_of_share"]
    at = np.linspace(0.05, 0.95, 19)
    off = np.interp(at, found["score"], found["probability"]) - curve(at)
    assert np.abs(off).max() < 0.15
    assert np.abs(off).mean() < 0.05
    fresh, right = drawn(rng, 4000, curve)
    stated = np.interp(fresh, found["score"], found["probability"])
    assert reliability(stated, right).expected_error < 0.06


def test_where_scores_mislead_from_camera_to_camera_the_share_of_right_events_says_more():
    rng = np.random.default_rng(1)
    parts = [drawn(rng, 300, lambda s: 0.6 * s), drawn(rng, 300, lambda s: 0.6 - 0.6 * s)]
    misled = benchmark.calibrate(parts)
    assert misled["brier_score"] > misled["brier_score_of_share"]


def test_cameras_that_differ_are_told_from_those_that_do_not():
    """Twelve activities of two cameras, whose log odds differ by a normal of known spread."""
    rng = np.random.default_rng(2)

    def difference(spread: float) -> tuple[float, float]:
        parts = []
        for _ in range(2):
            score, away = rng.beta(0.4, 0.8, 300), rng.normal(0, spread)
            odds = np.log(score / (1 - score)) + away
            parts.append((score, rng.random(300) < 1 / (1 + np.exp(-odds))))
        return benchmark.camera_difference(parts)

    spread, at_most = benchmark.camera_spread([difference(0.0) for _ in range(12)])
    assert spread < 0.25 and at_most < 0.5
    spread, at_most = benchmark.camera_spread([difference(1.0) for _ in range(12)])
    assert 0.6 < spread < 1.5 and at_most > 1


def test_the_simulated_detector_errs_as_it_is_told():
    """Boxes that stand still: how many are lost, and by how much the others are displaced."""
    frame = np.repeat(np.arange(600), 2)
    track = np.tile([1, 2], 600)
    box = np.where(track[:, None] == 1, [100.0, 100, 140, 200], [300.0, 100, 420, 160])
    kind = np.where(track == 1, "person", "vehicle")
    true = Detections.from_boxes((640, 480), frame, box, track=track, class_name=kind)
    look = Look(np.arange(600), np.arange(600) / 10, replace(true, time_s=frame / 10))
    errors = replace(ERRORS, false=0.0)
    (seen,) = (one.detections for one in SimulatedDetector(errors)([look]))
    assert (seen.track == -1).all() and (np.diff(seen.frame) >= 0).all()
    lost = errors.lost[0] / (errors.lost[0] + 1 - errors.stays_lost[0])
    assert 0.3 * lost < 1 - len(seen) / 1200 < 2.5 * lost
    person = seen.class_name == "person"
    off = (seen.box_xyxy[person] - [100, 100, 140, 200]) / [40, 100, 40, 100]
    assert (np.abs(off.std(axis=0) / errors.edge - 1) < 0.35).all()
    assert 0.5 < np.corrcoef(off[:-1, 0], off[1:, 0])[0, 1] < 0.95
    (more,) = (one.detections for one in SimulatedDetector(ERRORS)([look]))
    assert len(seen) < len(more) < 1.2 * len(seen)
