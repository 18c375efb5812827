"""What is not understood is refused with one clear sentence, and nothing else is ever raised."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from words_scenes import LINES, ZONES, catalogue, parsed

from scene4d.core.errors import InputError
from scene4d.searching.language import Query
from scene4d.searching.language._grammar import build_grammar
from strategies import ANY_TEXT

WORDS = sorted(build_grammar(catalogue().values()).terminals)
OTHERS = ["3", "10 s", "14:00", "9 pm", "30 km/h", "3 m", ",", "'s", "entrance", "gate", "zone"]
STEADY = [
    "person", "vehicle", "near", "enters", "then", "and", "while", "is", "not", "the", "a",
    "another", "for", "10", "s", "within", "3", "m", "stops", "it", "who", "parked", "in",
    "entrance", "after", "9", "pm", "before", ",", "two", "people", "each", "other",
]  # fmt: skip


def understood_or_refused(text):
    try:
        assert isinstance(parsed(text), Query)
    except InputError as error:
        assert str(error).startswith(("search", "activity"))


@settings(max_examples=20)
@given(st.text(ANY_TEXT, max_size=80))
@example("")
@example("   ")
@example("\x00")
@example("person ²")
@example("²³ m")
@example("person near vehicle within ٣ m")
@example("can't won't n't 's")
@example('"')
@example('"entrance"')
@example("zone zone zone")
@example("İ ŉ ß ﬁ")
def test_random_text(text):
    understood_or_refused(text)


@settings(max_examples=8)
@given(st.lists(st.sampled_from(STEADY) | st.sampled_from(WORDS + OTHERS), max_size=12))
def test_random_words_that_are_known(words):
    """Half of them from those that often fit together."""
    understood_or_refused(" ".join(words))


@settings(max_examples=6)
@given(st.data())
def test_two_searches_joined_by_anything(data):
    clauses = st.sampled_from([
        "person enters vehicle", "a car stops", "it is near a person for 10 s", "he is moving",
        "person is in zone entrance", "vehicle turns left", "two people meet", "crosses line gate",
        "person appears", "is not near the vehicle", "the other person leaves it",
    ])  # fmt: skip
    links = st.sampled_from(
        [" then ", " and ", " while ", " before ", " after ", ", then within 5 s "]
    )
    text = data.draw(clauses)
    for _ in range(data.draw(st.integers(1, 3))):
        text += data.draw(links) + data.draw(clauses)
    understood_or_refused(text)


@pytest.mark.parametrize(
    ("text", "position", "says"),
    [
        ("person bords vehicle", 8, '"board"'),
        ("persn enters vehicle", 1, '"person"'),
        ("person entrs vehicle", 8, '"enter"'),
        ("person enters vehicle xylophone", 23, "not a known word"),
        ("person enters zone entrence", 20, '"entrance"'),
        ("person crosses line gat", 21, '"gate"'),
        ("person carries bag", 8, "what comes closest"),
        ("car turns right then left", 22, "turns left"),
        ("person near vehicle within 3", 28, "needs a unit"),
        ("person near vehicle within 3 of", 28, "needs a unit"),
        ("person near vehicle and", 24, "it ends too early"),
        ("vehicle enters vehicle", 1, "a person is expected"),
        ("person gets on a bicycle", 8, "not seen"),
        ("is not near", 4, "who?"),
        ("it stops", 1, "nobody was named"),
        ("person is in zone", 14, "which zone"),
        ("person ; enters @ vehicle", 17, "@"),
        ("person lowers arm then vehicle raises arm", 32, "person only"),
        ("person within 10 s of vehicle", 1, "does what?"),
    ],
)
def test_the_place_and_the_remedy_are_named(text, position, says):
    with pytest.raises(InputError) as caught:
        parsed(text)
    assert f"position {position}: " in str(caught.value)
    assert says in str(caught.value)


def test_places_that_nobody_named():
    with pytest.raises(InputError, match="none has been named"):
        parsed("person in zone entrance", zones=(), lines=())
    with pytest.raises(InputError, match="is a zone and a line"):
        parsed("person crosses gate", zones=("gate",), lines=("gate",))
    query = parsed("person crosses line gate", zones=("gate",), lines=("gate",))
    assert query.predicates == ["crosses(person, line=gate)"]


@pytest.mark.parametrize("name", ["car", "person", "left", "park 3", "Straße", "A-1", "near"])
def test_a_place_may_have_any_name(name):
    """A word that means something else must follow "zone"; any name may be quoted."""
    for said in (f"zone {name}", f'"{name}"'):
        query = parsed(f"vehicle is in {said}", zones=(name,), lines=())
        assert query.predicates == [f"inside(vehicle, zone={name})"]


def test_a_long_search_is_read_and_a_longer_one_is_refused():
    text = " and then ".join(["person is near a parked vehicle for 1 min 30 s"] * 4)
    assert len(parsed(text).activity.phases) == 4
    with pytest.raises(InputError, match="at most"):
        parsed(" and then ".join(["person is near vehicle"] * 20), ZONES, LINES)
