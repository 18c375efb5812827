"""JSON objects that may hold anything: what is read, and how the error names what is not."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from strategies import ANY_TEXT

GOOD: dict[str, Any] = {
    "schema": "a/1",
    "text": "words",
    "flag": False,
    "number": 2.5,
    "whole": 7,
    "matrix": [[1, 2.0], [3, 4], [5, 6]],
    "texts": ["a", "b"],
    "inner": {"x": 1},
    "list": [{"x": 1}, {"x": 2}],
    "nothing": None,
}


def test_fields_are_read_with_their_types():
    found = JsonObject(GOOD, "a.json")
    assert found.text("text") == "words"
    assert found.flag("flag") is False
    assert found.number("number") == 2.5
    assert found.number("whole", least=7.0, most=7.0, above=6.9) == 7.0
    assert found.integer("whole", least=7) == 7
    np.testing.assert_array_equal(found.array("matrix", 3, 2), GOOD["matrix"])
    np.testing.assert_array_equal(found.array("matrix", None, 2), GOOD["matrix"])
    assert found.array("number").shape == ()
    assert found.texts("texts") == ("a", "b")
    assert found.object("inner").integer("x") == 1
    assert [item.number("x") for item in found.objects("list")] == [1.0, 2.0]
    assert "nothing" not in found and "other" not in found and "flag" in found
    assert "nothing" not in found.names() and "flag" in found.names()


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda o: o.text("whole"), "'whole' must be a text, found 7"),
        (lambda o: o.flag("whole"), "'whole' must be true or false, found 7"),
        (lambda o: o.number("flag"), "'flag' must be a number, found False"),
        (lambda o: o.number("number", above=2.5), "'number' must be a number, greater than 2.5"),
        (
            lambda o: o.number("number", least=3.0, most=9.0),
            "a number, at least 3 and at most 9",
        ),
        (lambda o: o.integer("number"), "'number' must be a whole number, found 2.5"),
        (lambda o: o.integer("whole", least=8), "'whole' must be a whole number, at least 8, fou"),
        (lambda o: o.array("matrix", 2, 3), "'matrix' must be 2x3 finite numbers, found [[1, 2"),
        (lambda o: o.array("texts", None), "'texts' must be n finite numbers, found ['a', 'b']"),
        (lambda o: o.texts("list"), "'list' must be a list of texts"),
        (lambda o: o.object("list"), "'list' must be an object, found [{'x': 1}, {'x': 2}]"),
        (lambda o: o.objects("inner"), "'inner' must be a list of objects, found {'x': 1}"),
        (lambda o: o.objects("texts"), "'texts[0]' must be an object, found 'a'"),
        (lambda o: o.object("inner").text("x"), "'inner.x' must be a text, found 1"),
        (lambda o: o.objects("list")[1].text("x"), "'list[1].x' must be a text, found 2"),
        (lambda o: o.number("nothing"), "'nothing' is missing: it must be a number"),
        (lambda o: o.object("other"), "'other' is missing: it must be an object"),
        (lambda o: o.only(["text", "flag"]), "unknown field 'inner'; known: text, flag"),
    ],
)
def test_what_is_otherwise_is_named(read, message):
    with pytest.raises(InputError) as caught:
        read(JsonObject(GOOD, "a.json"))
    assert str(caught.value).startswith("a.json: ") and message in str(caught.value)


HUGE = 10**400


@pytest.mark.parametrize("value", [HUGE, -HUGE, float("nan"), float("inf"), True, "1", [1], {}])
def test_what_is_no_finite_number_is_none(value):
    """R15: 10^400 is a number for JSON, and none for a float."""
    found = JsonObject({"x": value, "xs": [1.0, value]}, "a.json")
    for read in (found.number, found.integer, lambda name: found.array("xs", 2)):
        with pytest.raises(InputError):
            read("x")


@pytest.mark.parametrize(
    "rows", [[[1, 2], [3]], [[1, 2], 3], [[[1]], [[2]]], 3, "ab", [["a", "b"]]]
)
def test_lists_of_other_shapes_are_none(rows):
    with pytest.raises(InputError, match="nx2 finite numbers"):
        JsonObject({"x": rows}, "a.json").array("x", None, 2)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.just(HUGE) | st.text(ANY_TEXT),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(ANY_TEXT), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(value=ANYTHING)
def test_anything_is_read_or_refused_in_few_words(value):
    found = JsonObject({"x": value}, "a.json")
    readers = [found.text, found.flag, found.number, found.integer, found.texts, found.object]
    readers += [found.objects, lambda name: found.array(name, None, 2)]
    for read in readers:
        try:
            read("x")
        except InputError as error:
            assert len(str(error)) < 200
    try:
        JsonObject(value, "a.json")
    except InputError as error:
        assert "a.json: must be an object, found" in str(error) and len(str(error)) < 150


def test_files_are_read_by_their_schema(tmp_path: Path):
    path = tmp_path / "a.json"
    path.write_bytes(b"\xef\xbb\xbf" + json.dumps(GOOD).encode())  # R19: a byte order mark
    assert JsonObject.read(path, "b/1", "a/1").text("text") == "words"
    assert JsonObject.read(path).text("text") == "words"
    with pytest.raises(InputError, match=r"a\.json: field \"schema\" must be 'b/1' or 'b/2', fou"):
        JsonObject.read(path, "b/1", "b/2")
    path.write_text("1" * 5000)
    with pytest.raises(InputError, match=r"a\.json: is not JSON"):
        JsonObject.read(path)
