"""Every phrase of the catalogue, in all its synonyms, is its activity."""

import re
from dataclasses import replace

import pytest
from lemminflect import getAllLemmas, getInflection
from words_scenes import LINES, ZONES

from scene4d.core.errors import InputError
from scene4d.searching.activities._terms import check_term
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.language import parse_query, ways_to_say
from scene4d.searching.language._lexicon import base_forms, read_lexicon
from scene4d.searching.language._phrases import spelled
from scene4d.searching.predicates._registry import PREDICATES

CATALOGUE = load_catalogue()
GENERAL = {"person": ("pedestrian", "someone", "a human", "the person", "man", "a woman"),
           "vehicle": ("the vehicle", "a vehicle", "vehicles")}  # fmt: skip
# Where the verb of each set stands in a search, and what that search is.
OF_VERB = {
    "enter": ("person {} vehicle", "person_enters_vehicle"),
    "exit": ("person {} vehicle", "person_exits_vehicle"),
    "open": ("person {} trunk", "person_opens_trunk"),
    "close": ("person {} trunk", "person_closes_trunk"),
    "load": ("person {} vehicle", "person_loads_vehicle"),
    "unload": ("person {} vehicle", "person_unloads_vehicle"),
    "stop": ("vehicle {}", "vehicle_stops"),
    "start": ("vehicle {}", "vehicle_starts"),
    "turn_left": ("vehicle {}", "vehicle_turns_left"),
    "turn_right": ("vehicle {}", "vehicle_turns_right"),
    "pass": ("person {} person", "passes"),
    "overtake": ("person {} person", "overtakes"),
    "part": ("people {}", "people_part"),
    "u_turn": ("vehicle {}", "vehicle_makes_u_turn"),
    "reverse": ("vehicle {}", "vehicle_reverses"),
    "drop_off": ("vehicle {} person", "vehicle_drops_off_person"),
    "pick_up": ("vehicle {} person", "vehicle_picks_up_person"),
    "talk": ("person {} person", "person_talks_to_person"),
    "talk_together": ("people {}", "person_talks_to_person"),
    "meet": ("person {} person", "people_meet"),
    "follow": ("person {} person", "person_follows_person"),
    "form": ("crowd {}", "crowd_forms"),
}
SPELLED = {
    name: [" ".join(words) for p in read_lexicon().verbs[name].words for words in spelled(p)]
    for name in OF_VERB
}


def parsed(text):
    return parse_query(text, CATALOGUE, ZONES, LINES)


def what(activity):
    """All of an activity but who may play in it, and its names."""
    return activity.name, activity.phases, activity.relations


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_phrase_is_its_activity_whatever_general_nouns_it_has(name):
    """The first as it is written; each has its turn of the nouns."""
    assert parsed(CATALOGUE[name].phrases[0]).activity == CATALOGUE[name]
    for turn, phrase in enumerate(CATALOGUE[name].phrases, len(name)):
        kinds = {kind: words[turn % len(words)] for kind, words in GENERAL.items()}
        said = re.sub(r"\bperson\b", kinds["person"], phrase)
        said = re.sub(r"\bvehicle\b", kinds["vehicle"], said)
        said = re.sub(r"\bparked (a|the) ", r"\1 parked ", said)
        assert parsed(said).activity == CATALOGUE[name], said


@pytest.mark.parametrize("noun", ["car", "van", "truck", "bus", "lorry", "taxi", "motorbike"])
def test_kinds_of_vehicle_narrow_who_may_play_and_say_so(noun):
    phrase = ("person enters vehicle", "vehicle turns left")[len(noun) % 2]
    general, narrow = parsed(phrase), parsed(phrase.replace("vehicle", noun))
    assert what(narrow.activity) == what(general.activity)
    wide = {role.name: set(role.classes) for role in general.activity.roles}
    for role in narrow.activity.roles:
        assert set(role.classes) <= wide[role.name]
        if "vehicle" in role.name:
            assert set(role.classes) < wide[role.name]
            assert "vehicle" in role.classes  # those of unknown kind
    assert any(f'"{noun}" looks at' in note for note in narrow.notes)


@pytest.mark.parametrize("name", OF_VERB)
def test_every_synonym_in_one_form_or_another(name):
    """Several in one search, one after the other: it takes as long as one."""
    template, activity = OF_VERB[name]
    known = what(CATALOGUE[activity])[1]
    said = [_clause(template, verb, turn) for turn, verb in enumerate(SPELLED[name])]
    for some in (said[at : at + 5] for at in range(0, len(said), 5)):
        phases = parsed(" then ".join(some)).activity.phases
        assert len(phases) == len(some) * len(known), some
        for one, other in zip(phases, known * len(some), strict=True):
            predicates = [[term.predicate for term in phase.terms] for phase in (one, other)]
            assert predicates[0] == predicates[1], some


def _clause(template, verb, turn):
    tag = ("VBZ", "VBD", "VBN", "VBP")[turn % 4]
    first, *rest = verb.split()
    if first != "u-turn":
        first = getInflection(first, tag)[0]
    auxiliary = "has " if tag == "VBN" else ""
    return template.format(auxiliary + " ".join([first, *rest]))


@pytest.mark.parametrize(
    ("said", "same"),
    [
        ("vehicle picks person up", "vehicle picks up person"),
        ("the car drops a man off", "the car drops off a man"),
        ("person is picked up by a vehicle", "person is picked up"),
        ("person opens the trunk of the vehicle", "person opens trunk"),
        ("person opens the vehicle's boot", "person opens trunk"),
        ("PERSON ENTERS VEHICLE!", "person enters vehicle"),
        ("  person\tenters\n vehicle ", "person enters vehicle"),
        ("show me when a person enters a vehicle", "person enters vehicle"),
        ("person is entering vehicle", "person enters vehicle"),
        ("a man and a woman meet", "two people meet"),
        ("a person and another person talk", "people talk"),
    ],
)
def test_said_otherwise(said, same):
    one, other = parsed(said).activity, parsed(same).activity
    assert (one.name, one.roles, one.phases) == (other.name, other.roles, other.phases)


def test_all_sets_of_verbs_are_tried():
    lexicon = read_lexicon()
    used = " ".join(p for e in lexicon.states for p in (*e.verb, *e.relation))
    assert all(name in OF_VERB or f"${name}" in used for name in lexicon.verbs)


def test_the_lexicon_speaks_of_predicates_and_parameters_that_there_are():
    lexicon = read_lexicon()
    for entry in lexicon.states:
        assert all(name in PREDICATES for name in entry.replaces), entry
        first = PREDICATES[entry.holds[0].predicate]
        assert all(set(usual) <= set(first.parameters) for usual in entry.by_kinds.values()), entry
        for term in entry.holds:
            given = {k: v for k, v in term.parameters.items() if str(v)[0] != "{"}
            asked = {k: 1.0 for k, v in term.parameters.items() if str(v)[0] == "{"}
            asked |= {"zone": "z", "line": "l", "side": "back", "spot": "s"}
            known = {**given, **{k: v for k, v in asked.items() if k in term.parameters}}
            check_term(replace(term, parameters=known), "abc")


@pytest.mark.parametrize("number", range(len(read_lexicon().states)))
def test_the_example_of_a_state_says_it(number):
    entry = read_lexicon().states[number]
    names = ("NAME",)
    zones, lines = (names, ()) if "zone" in entry.example else ((), names)
    query = parse_query(entry.example, CATALOGUE, zones, lines)
    said = {term.predicate for term in query.activity.terms}
    assert {term.predicate for term in entry.holds} <= said, query.predicates


def test_every_example_of_a_way_to_say_more_is_understood():
    for phrases in ways_to_say().values():
        for phrase in phrases:
            assert parse_query(phrase, CATALOGUE, ("NAME",)).predicates


def test_words_of_the_lexicon_are_base_forms_or_stand_for_themselves():
    """A plural among the nouns would hide its singular."""
    lexicon = read_lexicon()
    nouns = [word for entry in lexicon.nouns for word in entry.words]
    assert len(nouns) == len(set(nouns))
    plurals = [word for word in nouns if set(base_forms(word)) & set(nouns)]
    assert plurals == []


def mine(phrase, *, roles=("person",)):
    kinds = tuple(Role(role, (role,)) for role in roles)
    terms = tuple(Term("moving", (role,)) for role in roles)
    return {"mine": Activity("mine", kinds, (Phase("moves", terms),), phrases=(phrase,))}


def test_words_of_ones_own_catalogue_become_known():
    activities = mine("person waters the hydrangeas")
    query = parse_query("a man is watering hydrangeas", activities)
    assert query.activity == activities["mine"]
    with pytest.raises(InputError, match="hydrangeas"):
        parsed("a man is watering hydrangeas")
    beside = mine("person dances next to vehicle", roles=("person", "vehicle"))
    assert parse_query("someone danced next to the vehicle", beside).activity == beside["mine"]


@pytest.mark.parametrize(
    "phrase", ["person", "person vehicle", "vehicle moves", "a", "two people walk"]
)
def test_phrases_that_cannot_be(phrase):
    with pytest.raises(InputError, match="phrase"):
        parse_query("person moves", mine(phrase))


def test_without_a_catalogue_states_can_still_be_asked_for():
    assert parse_query("person near vehicle", {}).predicates == ["near(person, vehicle)"]


def test_base_forms_are_those_of_lemminflect():
    # Of parts of speech that are read, and of those that its second file overrides.
    for word in ("enters", "left", "people", "parked", "her", "us", "could", "better", "entres"):
        every = [form for forms in getAllLemmas(word).values() for form in forms if form != word]
        assert set(base_forms(word)) == set(every), word
    assert base_forms("left")[0] == "leave"
