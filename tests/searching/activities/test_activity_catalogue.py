"""Reading catalogues: what is understood, and where mistakes are said to be."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.searching.activities._checking import check_activity
from scene4d.searching.activities._terms import parse_term, term_text
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity, Phase, Relation, Role, Term
from strategies import ANY_TEXT

GOOD = """\
activities:
  person_waits:
    description: Somebody stays beside another.
    phrases: [person waits]
    labels: [waiting]
    roles:
      person: person
      other: [person, bicycle]
    phases:
      - name: waits
        lasts: [2, .inf]
        holds:
          - near(person, other, tau_m=3)
          - not moving(person)
      - name: goes
        lasts: [1, 5]
        gap: 2
        holds: [moving(person)]
    relations:
      - [waits, meets, goes]
"""

NAMED = [
    "person_enters_vehicle",
    "person_exits_vehicle",
    "person_opens_trunk",
    "person_closes_trunk",
    "person_loads_vehicle",
    "person_unloads_vehicle",
    "vehicle_stops",
    "vehicle_starts",
    "vehicle_turns_left",
    "vehicle_turns_right",
    "vehicle_makes_u_turn",
    "vehicle_reverses",
    "vehicle_drops_off_person",
    "vehicle_picks_up_person",
    "person_talks_to_person",
    "person_enters_through_zone",
    "person_leaves_through_zone",
    "person_stands_near_parked_vehicle",
    "people_meet",
    "person_follows_person",
    "crowd_forms",
]


def _file(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text, "utf-8")
    return path


def test_the_catalogue_holds_what_was_asked_for():
    catalogue = load_catalogue()
    assert set(NAMED) <= set(catalogue)
    phrases = [phrase for activity in catalogue.values() for phrase in activity.phrases]
    assert len(phrases) == len(set(phrases))
    for activity in catalogue.values():
        assert activity.phrases and activity.description
        check_activity(activity)


def test_a_file_of_ones_own_is_read_beside_it(tmp_path):
    catalogue = load_catalogue(_file(tmp_path, GOOD))
    assert "person_enters_vehicle" in catalogue
    assert catalogue["person_waits"] == Activity(
        "person_waits",
        (Role("person", ("person",)), Role("other", ("person", "bicycle"))),
        (
            Phase(
                "waits",
                (
                    Term("near", ("person", "other"), {"tau_m": 3.0}),
                    Term("moving", ("person",), {}, True),
                ),
                2.0,
                math.inf,
            ),
            Phase("goes", (Term("moving", ("person",)),), 1.0, 5.0, 2.0),
        ),
        (Relation("waits", "meets", "goes"),),
        ("person waits",),
        ("waiting",),
        "Somebody stays beside another.",
    )


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("near(person", "naer(person", 13, "did you mean 'near'"),
        ("moving(person)\n", "moving(persn)\n", 14, "did you mean 'person'"),
        ("tau_m", "tau", 13, "did you mean 'tau_m'"),
        ("tau_m=3", "tau_m=-1", 13, "between 0"),
        ("tau_m=3", "tau_m=3 km/h", 13, "measured in m"),
        ("tau_m=3", "tau_m=close", 13, "a number of m"),
        ("near(person, other,", "near(person,", 13, "1 roles, expected 2"),
        ("near(person, other, tau_m=3)", "near person", 13, "is not a term"),
        ("near(person, other,", "near(person, person,", 13, "twice"),
        ("lasts: [2, .inf]", "lasts: [2, 1]", 11, "impossible duration, from 2 to 1 s"),
        ("lasts: [2, .inf]", "lasts: [-2, 1]", 11, "impossible duration"),
        ("lasts: [2, .inf]", "lasts: [.nan, 1]", 11, "impossible duration"),
        ("lasts: [2, .inf]", "lasts: 2", 11, "expected a list"),
        ("lasts: [2, .inf]", "lasts: [2]", 11, "1 numbers"),
        ("lasts: [2, .inf]", "lasts: [two, 3]", 11, "expected a number of seconds"),
        ("gap: 2", "gap: -2", 17, "gap"),
        ("gap: 2", "pause: 2", 17, "unknown key 'pause'"),
        ("phrases:", "frases:", 4, "did you mean 'phrases'"),
        ("person: person", "person: persn", 7, "did you mean 'person'"),
        ("[waits, meets, goes]", "[waits, mets, goes]", 20, "did you mean 'meets'"),
        ("[waits, meets, goes]", "[wait, meets, goes]", 20, "did you mean 'waits'"),
        ("[waits, meets, goes]", "[waits, meets]", 20, "expected [phase, relation, phase]"),
        ("name: goes", "name: waits", 3, "twice"),
        ("      other: [person, bicycle]", "      person: bicycle", 8, "twice"),
        ("description: Somebody stays beside another.", "description: [a]", 3, "expected a word"),
        ("    roles:\n", "    roles: [1, 2\n", None, "not valid YAML"),
        ("person_waits:", "person_enters_vehicle:", None, "exists already"),
        ("[person waits]", "[person enters vehicle]", None, "already means"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path, old, new, line, says):
    assert old in GOOD
    path = _file(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load_catalogue(path)
    assert str(error.value).startswith("mine.yaml, line ")
    assert says in str(error.value)
    if line is not None:
        assert f"line {line}:" in str(error.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("[]", "expected key: value"),
        ("{}", "no activities"),
        ("activities:\n  x: {roles: {a: person}}\n", "phases is missing"),
        ("activities:\n  x: {roles: {}, phases: []}\n", "no role"),
        ("a: &a [*a]\nactivities: {x: *a}", "unknown key 'a'"),
        ("activities: &a {x: *a}", "unknown key 'x'"),
        ("\x00", "not valid YAML"),
        ("!!python/object/apply:os.system ['true']", "expected key: value"),
    ],
)
def test_what_is_no_catalogue(tmp_path, text, says):
    with pytest.raises(InputError, match=r"mine\.yaml") as error:
        load_catalogue(_file(tmp_path, text))
    assert says in str(error.value)


def test_a_missing_file_and_one_in_another_encoding(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_catalogue(tmp_path / "none.yaml")
    (tmp_path / "latin.yaml").write_bytes("é".encode("latin-1"))
    with pytest.raises(InputError, match="cannot be read"):
        load_catalogue(tmp_path / "latin.yaml")


@given(st.text(ANY_TEXT, max_size=60))
def test_no_text_raises_anything_else(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("garbage") / "any.yaml"
    path.write_text(text, "utf-8", errors="replace")
    with pytest.raises(InputError):
        load_catalogue(path)


def test_units_are_converted():
    term = parse_term("turning_left(v, angle_rad=90deg, window_s=0.5 min)")
    assert term.parameters == {"angle_rad": pytest.approx(math.pi / 2), "window_s": 30.0}
    assert parse_term("speed_above(v, speed_mps=36 km/h)").parameters == {
        "speed_mps": pytest.approx(10.0)
    }
    assert parse_term("near(a, b, lag_s=.inf)").parameters == {"lag_s": math.inf}


def test_what_terms_may_not_say():
    for text in ("near(a, b, lag_s=-1)", "near(a, b, lag_s=x)", "inside(a)"):
        term = parse_term(text)
        activity = Activity(
            "x",
            (Role("a", ("person",)), Role("b", ("car",))),
            (Phase("p", (term, Term("far", ("a", "b")))),),
        )
        with pytest.raises(InputError, match="activity 'x': "):
            check_activity(activity)
    for text in ("near(a, tau_m=1, b)", "near(a, b, tau_m=1, tau_m=2)", "facing(a, b, side=top)"):
        with pytest.raises(InputError):
            term = parse_term(text)
            check_activity(
                Activity(
                    "x", (Role("a", ("person",)), Role("b", ("car",))), (Phase("p", (term,)),)
                ),
            )


def test_a_role_that_is_never_used():
    activity = Activity(
        "x",
        (Role("a", ("person",)), Role("b", ("car",))),
        (Phase("p", (Term("moving", ("a",)),)),),
    )
    with pytest.raises(InputError, match="'b': is used in no phase"):
        check_activity(activity)


_VALUES = st.floats(0, 1000) | st.just(math.inf)


@given(st.booleans(), st.dictionaries(st.sampled_from(["tau_m", "sigma_m", "lag_s"]), _VALUES))
def test_terms_read_back_as_written(negated, parameters):
    term = Term("near", ("one", "other"), parameters, negated)
    assert parse_term(term_text(term)) == term
