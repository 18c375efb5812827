"""What is read from files, and how messages quote it."""

import pytest

from scene4d.core.errors import InputError
from scene4d.core.text import floats, parse_xml, quoted


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("wide", "'wide'"),
        (None, "None"),
        ("\x1b[31mred\x07", r"'\x1b[31mred\x07'"),
        ("\u202eevil", r"'\u202eevil'"),  # would run right to left
        ({"a": [1, 2]}, "{'a': [1, 2]}"),
    ],
)
def test_what_a_file_says_is_quoted_harmlessly(value, text):
    assert quoted(value) == text


@pytest.mark.parametrize(
    "value", ["x" * 10**6, 7**999, [["long"] * 99] * 99, {i: i for i in range(99)}]
)
def test_what_is_long_is_cut(value):
    assert len(quoted(value)) <= 80


def test_an_integer_that_python_refuses_to_print():
    assert quoted(10**5000) == "a number of thousands of digits"


def test_numbers_quote_what_is_none():
    with pytest.raises(InputError) as caught:
        floats(["\x1b[2J" * 10**5], "line 3")
    assert len(str(caught.value)) < 120
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-32", "idna", "hex", "UTF-16", "nonsense"])
def test_the_encoding_that_xml_declares_is_of_no_account(encoding):
    """The text is UTF-8, as every file here; expat raised other errors for these."""
    assert parse_xml(f'<?xml version="1.0" encoding="{encoding}"?><a>é</a>').text == "é"
