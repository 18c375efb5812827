"""Who is meant, what comes when, and what is told to the reader."""

import re

import pytest
from words_scenes import catalogue, parsed, state_terms

from scene4d.core.errors import InputError
from scene4d.core.tracks import VEHICLES
from scene4d.searching.activities.definition import Relation
from scene4d.searching.language import explain

STATES = """
person near vehicle => near(person, vehicle)
person is not near vehicle => not near(person, vehicle)
person isn't near the vehicle => not near(person, vehicle)
person never moves => not moving(person)
person outside zone entrance => not inside(person, zone=entrance)
person is not outside zone entrance => inside(person, zone=entrance)
person near a parked car => near(person, vehicle) & stationary(vehicle)
person near a car that is parked => near(person, vehicle) & stationary(vehicle)
person near a car that is not parked => near(person, vehicle) & not stationary(vehicle)
person goes towards a car => moving_towards(person, vehicle)
person does not walk towards a car => not moving_towards(person, vehicle)
person faces the left side of a car => facing(person, vehicle, side=left)
person looks at a vehicle => facing(person, vehicle)
person in zone car park => inside(person, zone=car park)
a man near a car runs => near(person, vehicle) & speed_above(person, speed_mps=2.2)
a person in the entrance is not near a car =>
  inside(person, zone=entrance) & not near(person, vehicle)
a person is near a man who stands where a car stood =>
  near(person, person_2) & stationary(person_2) & near_spot(person_2, tau_m=2.5, spot=a car stood)
  & a car stood: stationary(vehicle)
person in "car park" => inside(person, zone=car park)
person in the Entrance => inside(person, zone=entrance)
person crosses the line gate => crosses(person, line=gate)
vehicle drives slower than 5 m/s => moving(vehicle) & speed_below(vehicle, speed_mps=5)
person is near vehicle and is moving => near(person, vehicle) & moving(person)
person moves and not near vehicle => moving(person) & not near(person, vehicle)
person near vehicle while the vehicle is reversing => near(person, vehicle) & reversing(vehicle)
person stands where a vehicle was parked ten minutes ago =>
  stationary(person) & near_spot(person, tau_m=2.5, spot=a vehicle was parked ten minutes ago)
  & a vehicle was parked ten minutes ago: stationary(vehicle)
person is where a vehicle was parked =>
  near_spot(person, tau_m=2.5, spot=a vehicle was parked) & a vehicle was parked:
  stationary(vehicle)
a person is not near anyone => alone(person)
two people near each other => near(person, person_2)
two people face each other => facing(person, person_2) & facing(person_2, person)
two people near a car => near(person, vehicle)
person next to vehicle => near(person, vehicle, tau_m=3.5)
person stands next to a car => stationary(person) & near(person, vehicle, tau_m=3.5)
a man waits next to the car => stationary(person) & near(person, vehicle, tau_m=3.5)
person walks next to a car =>
  moving(person) & speed_below(person, speed_mps=2.2) & near(person, vehicle, tau_m=3.5)
person crouches next to a car => stooping(person) & near(person, vehicle, tau_m=3.5)
two people stand next to each other for 10 seconds =>
  stationary(person) & stationary(person_2) & near(person, person_2, tau_m=2)
"""


@pytest.mark.parametrize("line", re.split(r"\n(?! )", STATES.strip()))
def test_states(line):
    said, terms = " ".join(line.split()).split(" => ")
    assert parsed(said).predicates == terms.split(" & ")


def roles_of(text):
    return [[t.roles for t in phase.terms] for phase in parsed(text).activity.phases]


def names(text):
    return [role.name for role in parsed(text).activity.roles]


def test_the_vehicle_is_the_one_named_before_and_another_is_not():
    assert names("person enters vehicle then the vehicle starts") == ["person", "vehicle"]
    assert names("person enters vehicle then it starts") == ["person", "vehicle"]
    for said in ("vehicle then another vehicle starts", "car then the truck starts"):
        assert names(f"person enters {said}") == ["person", "vehicle", "vehicle_2"]


def test_a_second_a_is_somebody_new_and_the_reader_is_told():
    query = parsed("a person is near a vehicle then a person is near the vehicle")
    assert [role.name for role in query.activity.roles] == ["person", "vehicle", "person_2"]
    assert any('"a person" is taken as somebody new' in note for note in query.notes)


def test_nobody_does_anything_to_himself():
    assert roles_of("person is near a person") == [[("person", "person_2")]]
    with pytest.raises(InputError, match="each other"):
        parsed("person near each other")


def test_he_is_the_last_subject_and_the_reader_is_told_of_others():
    query = parsed("person follows person then he crosses line gate")
    assert query.activity.phases[-1].terms[0].roles == ("person",)
    assert any('"he"' in note and "other" in note for note in query.notes)


def test_after_turns_the_order():
    before = parsed("vehicle stops before person exits vehicle").activity
    after = parsed("person exits the vehicle after vehicle stops").activity
    first = parsed("after vehicle stops, person exits vehicle").activity
    assert before.phases == after.phases == first.phases
    assert before.phases[2].gap_s == 600
    soon = parsed("vehicle stops within 10 s before person exits vehicle").activity
    assert soon.phases[2].gap_s == 10


@pytest.mark.parametrize(
    ("said", "gap"),
    [
        ("then", 60),
        ("and then", 60),
        ("then within 5 s", 5),
        ("then immediately", 3),
        (", then", 60),
    ],
)
def test_pauses(said, gap):
    query = parsed(f"person enters vehicle {said} the vehicle starts")
    assert [phase.gap_s for phase in query.activity.phases][2] == gap
    assert (gap == 60) == any("60 s later" in note for note in query.notes)


def test_next_is_then_and_next_to_is_a_place():
    then = parsed("person stands next near a car").activity
    assert [phase.name for phase in then.phases] == ["stationary", "near"]
    then = parsed("person enters vehicle and next it starts").activity
    assert then.phases == parsed("person enters vehicle then it starts").activity.phases
    both = parsed("person stands near a car and next to another car").activity
    assert len(both.phases) == 1
    for text in ("person stands next to a car", "two people stand next to each other"):
        query = parsed(text)
        assert len(query.activity.phases) == 1
        assert not any("then" in note or "could be" in note for note in query.notes)


def test_a_lasting_state_around_an_event_is_an_allen_relation():
    activity = parsed("person is near vehicle for 60 s while another person enters it").activity
    assert activity.relations == (
        Relation("stays", "during", "near"),
        Relation("vanishes", "during", "near"),
    )


@pytest.mark.parametrize(
    ("said", "first", "second"),
    [
        ("a person walks up to a car and stands beside it", "moving_towards", "stationary"),
        ("a person walks up to a car and crouches", "moving_towards", "stooping"),
        ("a person stands near a car and walks away", "stationary", "moving_away"),
        ("a person walks and runs", "speed_below", "speed_above"),
        ("a person walks towards a car and away from it", "moving_towards", "moving_away"),
        ("a truck is parked and starts", "stationary", "speed_above"),
    ],
)
def test_what_excludes_one_another_comes_one_after_the_other(said, first, second):
    query = parsed(said)
    phases = [{term.predicate for term in phase.terms} for phase in query.activity.phases]
    assert first in phases[0] - phases[-1]
    assert second in phases[-1] - phases[0]
    assert any('is taken as "then"' in note for note in query.notes)


def test_seconds_are_no_second_person_and_who_gets_out_walks_away():
    (phase,) = parsed("for 10 seconds a person is not near a car").activity.phases
    assert phase.min_s == 10
    *_, last = parsed("two people get out of a car and walk away").activity.phases
    assert {term.roles[0] for term in last.terms} == {"person", "person_2"}


def test_there_is_the_zone_named_last_and_who_runs_into_it_runs():
    *_, last = parsed(
        "a person runs into the entrance and stays there for 5 minutes"
    ).activity.phases
    assert (last.min_s, last.terms[0].parameters) == (300, {"zone": "entrance"})
    first, *_ = parsed("a person runs into the entrance").activity.phases
    assert [term.predicate for term in first.terms] == ["inside", "speed_above"]
    with pytest.raises(InputError, match="there"):
        parsed("a person stands there")


def test_what_both_do_is_not_read_of_the_last():
    for said in ("a person in the entrance and a car near the door stop",
                 "a person in the entrance and a car stop"):  # fmt: skip
        with pytest.raises(InputError, match="of both, or of the last"):
            parsed(said)
    parsed("a person in the entrance and a car stops")


def test_two_who_differ_do_so_at_the_same_time():
    query = parsed("a person walks to a car and another person stands beside it")
    assert len(query.activity.phases) == 1


@pytest.mark.parametrize(
    "said",
    ["a parked car moves", "a car that was parked moves", "a person runs while standing",
     "a person in black and white", "a car is black and red"],
)  # fmt: skip
def test_what_is_never_so_at_the_same_time_is_refused(said):
    with pytest.raises(InputError, match="never so at the same time"):
        parsed(said)


def test_a_moment_beside_what_lasts():
    """A moment and an activity with "and" come in order; with "while" one is within the other."""
    query = parsed("vehicle stops and person crosses line gate")
    assert [phase.name for phase in query.activity.phases][-1] == "crosses"
    assert any('is taken as "then"' in note for note in query.notes)
    within = parsed("person crosses line gate while vehicle turns left").activity
    assert within.relations == (Relation("crosses", "during", "turns"),)
    within = parsed("person near vehicle for 1 min while another person crosses line gate").activity
    assert within.relations == (Relation("crosses", "during", "near"),)
    with pytest.raises(InputError, match="while"):
        parsed("person crosses line gate while vehicle stops")
    both = parsed("person crosses line gate while a vehicle is moving").activity
    assert [(p.min_s, p.max_s, len(p.terms)) for p in both.phases] == [(0.2, 1, 2)]


def test_a_state_beside_an_event_holds_throughout_it():
    activity = parsed("person enters vehicle while another vehicle is moving").activity
    assert all(phase.terms[-1].roles == ("vehicle_2",) for phase in activity.phases)


def test_how_long_is_said_of_the_phase_that_may_last():
    activity = parsed("two people meet for more than 5 minutes").activity
    assert [phase.min_s for phase in activity.phases] == [
        *(phase.min_s for phase in catalogue()["people_meet"].phases[:-1]), 300,
    ]  # fmt: skip


def test_how_near_goes_into_the_activity():
    terms = [t for p in parsed("person enters vehicle within 1 m").activity.phases for t in p.terms]
    assert {t.parameters["tau_m"] for t in terms if t.predicate == "near"} == {1.0}
    with pytest.raises(InputError, match="of whom"):
        parsed("vehicle turns left within 1 m")


def test_an_activity_that_could_be_a_state_is_told():
    done, is_so = parsed("vehicle turns left"), parsed("vehicle is turning left")
    assert done.activity == catalogue()["vehicle_turns_left"]
    assert is_so.activity.name == "vehicle is turning left"
    assert any("turning_left(vehicle)" in note for note in done.notes)
    assert any("vehicle_turns_left" in note for note in is_so.notes)


def test_words_that_say_more_than_is_searched_for_are_told():
    notes = parsed("a woman runs to the taxi").notes
    assert any("woman" in note for note in notes)
    assert any("taxi" in note for note in notes)
    assert parsed("person enters vehicle").notes == []


def test_any_vehicle_is_all_of_the_models():
    (role,) = parsed("vehicle is moving").activity.roles
    assert set(role.classes) == set(VEHICLES)


def test_the_explanation_has_all_of_it():
    query = parsed("after 9 pm person stands near a car for 10 s then crosses line gate")
    lines = explain(query.activity, query.window, query.notes)
    assert "time of day: 21:00 to 24:00" in lines
    assert all(any(line.strip() == said for line in lines) for said in query.predicates)
    assert all(f"note: {note}" in lines for note in query.notes)


def test_a_zone_of_the_catalogue_is_replaced_by_the_one_that_is_named():
    terms = [
        t for p in parsed("person enters through zone entrance").activity.phases for t in p.terms
    ]
    assert {t.parameters.get("zone") for t in terms} == {None, "entrance"}
    phase, _ = state_terms("person in the zone entrance")
    assert phase.terms[0].parameters == {"zone": "entrance"}


def phases_of(text):
    return parsed(text).activity.phases


def test_who_leaves_after_entering_is_who_entered():
    query = parsed("a person runs away after getting out of a car")
    assert [role.name for role in query.activity.roles] == ["person", "vehicle"]
    assert names("it starts after a person enters the vehicle") == ["person", "vehicle"]


def test_whoever_was_needed_and_not_named_is_named_by_the_next_noun():
    assert names("a person who stands next to a car gets in") == ["person", "vehicle"]


def test_within_is_a_pause_and_for_is_a_duration():
    (_, stands), (_, starts) = (
        [(p.min_s, p.gap_s) for p in phases_of(f"vehicle stops {said}")][1:3]
        for said in ("for 20 s", "and it starts within 20 s")
    )
    assert stands == (20, 2)
    assert starts[1] == 20
    with pytest.raises(InputError, match="of what"):
        parsed("vehicle stops within 20 s")


@pytest.mark.parametrize(
    ("said", "value"),
    [
        ("person follows vehicle", 15.0),
        ("vehicle is following a vehicle", 30.0),
        ("vehicle near vehicle", 8.0),
        ("vehicle next to vehicle", 5.0),
        ("person next to person", 2.0),
        ("person next to vehicle", 3.5),
    ],
)
def test_kinds_have_their_own_distances(said, value):
    (term,) = phases_of(said)[0].terms
    assert term.parameters["tau_m"] == value


def test_several_are_counted_where_a_state_allows_it():
    for said, count in (("three people", 3), ("at least 4 people", 4), ("more than 4 people", 5)):
        (role, *_) = parsed(f"{said} stand near a car").activity.roles
        assert (role.name, role.count) == ("person", count)
    (term, _) = phases_of("three people stand together")[0].terms
    assert (term.predicate, term.parameters["count"]) == ("crowded", 3.0)
    with pytest.raises(InputError, match="not counted"):
        parsed("five people enter a vehicle")


def test_passives_swap_who_does_it():
    active, passive = parsed("person opens trunk"), parsed("the trunk is opened by a person")
    assert passive.activity.phases == active.activity.phases
    query = parsed("a vehicle is followed by a person")
    assert query.predicates == ["following(person, vehicle, tau_m=15, sigma_m=4)"]
    with pytest.raises(InputError):
        parsed("a vehicle is entering by a person")


def test_names_of_the_catalogue_and_of_other_data_are_searches():
    for text in ("person_enters_vehicle", "vehicle_turns_left"):
        assert parsed(text).activity == catalogue()[text]
    exits = parsed("person_exits_scene_through_structure").activity
    assert exits == catalogue()["person_leaves_through_structure"]


def test_what_becomes_so_becomes_so_for_both_and_is_not_denied():
    before, after = phases_of("two people enter the car park together")
    assert [term.negated for term in before.terms] == [True, True, False]
    assert not any(term.negated for term in after.terms)
    with pytest.raises(InputError, match="denies"):
        parsed("person does not enter zone entrance")
    for said in ("person doesn't stop", "person talks to three people"):
        with pytest.raises(InputError):
            parsed(said)


def test_who_was_somewhere_is_read_of_the_event_and_said_so():
    was, is_so = (parsed(f"a person who {word} near a car runs") for word in ("was", "is"))
    assert was.predicates == is_so.predicates
    assert any('"who was near a car"' in note and "then" in note for note in was.notes)
    assert not any("then" in note for note in is_so.notes)
