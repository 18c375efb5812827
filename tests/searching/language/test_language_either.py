""" "Or" between clauses, nobody, and zones one is near: how they are decomposed."""

import pytest
from words_scenes import parsed

from scene4d.core.errors import InputError
from scene4d.searching.language import explain

RUNS, STANDS = "speed_above(person, speed_mps=2.2)", "stationary(person)"
NEAR, ENTERS, EXITS = "near(person, vehicle)", "disappears_into", "appears_from"


@pytest.mark.parametrize(
    ("said", "first", "second"),
    [
        ("a person enters or exits a vehicle", [ENTERS], [EXITS]),
        ("a person gets on or off a bus", [ENTERS], [EXITS]),
        ("a person enters a vehicle or a person exits a vehicle", [ENTERS], [EXITS]),
        ("a person runs or a vehicle turns left", [RUNS], ["turning_left"]),
        ("either a person runs or a bus stops", [RUNS], ["speed_below(vehicle"]),
        ("a vehicle turns left or right", ["turning_left"], ["turning_right"]),
        ("a person runs or stands near a car", [RUNS, NEAR], [STANDS, NEAR]),
        ("a person stands near a car or runs", [STANDS, NEAR], [RUNS]),
        ("person near a vehicle or stops", [NEAR], ["moving(person)"]),
        ("a person walks towards a car or away from a bus",
         ["speed_below", "moving_towards(person"], ["speed_below", "moving_away(person"]),
        ("nobody is in zone entrance or a person runs", ["inside(nobody"], [RUNS]),
        ("a red car or a white van stops", ["colour=red", "moves"], ["colour=white", "moves"]),
        ("a red or white car stops", ["colour=red", "moves"], ["colour=white", "moves"]),
        ("a person enters a red car or a white car", [ENTERS, "=red"], [ENTERS, "=white"]),
        ("nobody or one person runs", ["speed_above(nobody"], [RUNS]),
    ],
)  # fmt: skip
def test_each_alternative_says_all_of_it(said, first, second):
    either = parsed(said).activity.alternatives
    assert len(either) == 2
    for one, terms in zip(either, (first, second), strict=True):
        lines = "\n".join(explain(one, None, ()))
        assert [term for term in terms if term not in lines] == [], lines
        others = [term for term in (*first, *second) if term not in terms]  # nothing of the other
        assert [term for term in others if term in lines] == [], lines


def test_what_is_shared_is_told_and_who_may_play_is_of_all():
    query = parsed("a person runs or a car stands near a truck or stops after 9 pm")
    first, *_ = query.activity.alternatives
    assert first.name == "a person runs"
    assert [role.name for role in query.activity.roles][:2] == ["person", "vehicle"]
    assert str(query.window) == "21:00 to 24:00"
    assert any("every alternative" in note for note in query.notes)
    assert explain(query.activity, None, ())[0] == 'either "a person runs"'


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("a bus stops then a person exits it or a person enters it", "search twice"),
        ("a person runs, walks or stands", "search twice"),
        ("a person runs while a car stops or a bus stops", "search twice"),
        ("a person runs or", "or"),
        ("or a person runs", "or"),
        ("a person runs after 9 pm or a car stops after 6 pm", "two times"),
        ("a person enters a vehicle or leaves it", "nobody was named"),
        ("a person does not run or stand", "of both, or of either"),
        ("a person is not in zone entrance or zone door", "of both, or of either"),
        ("nobody is in zone entrance or zone door", "of both, or of either"),
        ("no one runs or stands in zone entrance", "of both, or of either"),
        ("a player stops and turns around", "a vehicle is expected"),
        ("nobody enters the car park", "of nobody only a state"),
        ("nobody is in zone entrance and a car stops", "of nobody only a state"),
        ("a car stops then nobody is in zone entrance", "of nobody only a state"),
        ("zone entrance is not empty", "say who is there"),
        ("the zone is empty", "which zone"),
        ("a person stands where nobody stood", "where somebody never was"),
        ("a person goes from zone entrance to zone door for 10 s", "how long"),
    ],
)
def test_what_cannot_be_told_is_refused(said, why):
    with pytest.raises(InputError, match=why):
        parsed(said)


@pytest.mark.parametrize(
    ("said", "classes", "lines", "least_s"),
    [
        ("nobody in zone entrance for 2 minutes", 1, ["inside(nobody, zone=entrance)"], 120),
        ("no vehicle is in the car park for 10 s", 6, ["inside(no_vehicle, zone=car park)"], 10),
        ("the entrance is empty", 7, ["inside(nothing, zone=entrance)"], 1),
        ("empty car park for 1 min", 7, ["inside(nothing, zone=car park)"], 60),
        ("the entrance is free of vehicles", 6, ["inside(no_vehicle, zone=entrance)"], 1),
        ("nobody runs in the entrance", 1,
         ["inside(nobody, zone=entrance)", "speed_above(nobody, speed_mps=2.2)"], 1),
        ("nobody for 10 minutes", 1, ["present(nobody)"], 600),
    ],
)  # fmt: skip
def test_nobody_is_a_role_that_nobody_plays(said, classes, lines, least_s):
    query = parsed(said)
    (role,), (phase,) = query.activity.roles, query.activity.phases
    assert role.absent
    assert len(role.classes) == classes
    assert (query.predicates, phase.min_s) == (lines, least_s)
    assert "of whom there is none" in explain(query.activity, None, ())[0]


def test_places_one_is_near_and_goes_between():
    assert parsed("person waits beside the door").predicates[1:] == [
        "near_zone(person, zone=door, tau_m=1.5)"
    ]
    assert parsed("car within 3 m of zone entrance").predicates == [
        "near_zone(vehicle, zone=entrance, tau_m=3)"
    ]
    one, other = parsed("a car drives from zone entrance to zone door").activity.phases
    assert (one.terms[0].parameters, other.terms[0].parameters) == (
        {"zone": "entrance"},
        {"zone": "door"},
    )
    soon = parsed("a car goes from zone entrance to zone door within 2 minutes").activity
    assert soon.phases[1].gap_s == 120
    for said in ("walks to the door", "approaches the door", "comes close to the door"):
        assert parsed(f"a person {said}").predicates == [
            "not near_zone(person, zone=door)", "near_zone(person, zone=door)",
        ]  # fmt: skip
    assert parsed("person more than 5 m away from the door").predicates == [
        "not near_zone(person, zone=door, tau_m=5)"
    ]
    with pytest.raises(InputError, match="draw a zone or line of that name"):
        parsed("somebody stands beside the door", zones=())
