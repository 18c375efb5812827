"""Searches by the colours of clothes and vehicles."""

from dataclasses import replace

import numpy as np
import pytest
from predicate_stages import Path, rows_of, stage_of

from scene4d.core.colours import CLOTHES, PALETTE, members
from scene4d.core.errors import InputError
from scene4d.searching.activities._terms import check_term, parse_term
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.language import parse_query
from scene4d.searching.predicates._looks import coloured


def colours(upper: str, lower: str, share: float = 0.9) -> np.ndarray:
    halves = np.full((2, len(PALETTE)), (1 - share) / (len(PALETTE) - 1))
    for half, name in zip(halves, (upper, lower), strict=True):
        half[PALETTE.index(name)] = share
    return halves.ravel()


def stage():
    n = 5
    path = Path(np.arange(n) * 0.2, np.ones((n, 2)), np.ones((n, 2)))
    world = stage_of(path, path, path)
    shown = np.zeros((len(world.tracks), 46), np.float32)
    shown[4], shown[5:10] = colours("red", "dark blue"), colours("black", "grey")
    return replace(world, tracks=replace(world.tracks, colours=shown))


def test_the_last_row_of_a_track_counts_in_all_and_the_unknown_is_as_common_as_usual():
    world = stage()
    first, second, third = (rows_of(world, track) for track in (1, 2, 3))
    np.testing.assert_allclose(coloured(first, colour="red"), 0.9 + 0.1 / 22, atol=1e-6)
    np.testing.assert_allclose(coloured(first, colour="dark", part="lower"), 0.924, atol=5e-3)
    np.testing.assert_allclose(coloured(second, colour="red"), 2 * 0.1 / 22, atol=1e-6)
    np.testing.assert_allclose(coloured(third, colour="red"), CLOTHES[members("red")].sum())


@pytest.mark.parametrize(
    ("said", "terms"),
    [
        ("a person in red", ["coloured(person, colour=red, part=upper)"]),
        ("a man in a dark jacket runs", ["coloured(person, colour=dark, part=upper)"]),
        ("a woman with a blue top", ["coloured(person, colour=blue, part=upper)"]),
        ("person in black trousers", ["coloured(person, colour=black, part=lower)"]),
        ("a silver car stops", ["coloured(vehicle, colour=grey, part=upper)"]),
        ("a dark blue car", ["coloured(vehicle, colour=dark blue, part=upper)"]),
        ("the car is white", ["coloured(vehicle, colour=white, part=upper)"]),
        ("someone wears navy jeans", ["coloured(person, colour=dark blue, part=lower)"]),
        ("a person in dark clothes", [f"coloured(person, colour=dark, part={p})"
                                      for p in ("upper", "lower")]),
        ("a person wearing a red shirt and blue jeans enters a white van",
         ["coloured(person, colour=red, part=upper)", "coloured(person, colour=blue, part=lower)",
          "coloured(vehicle, colour=white, part=upper)"]),
        ("a person who does not wear red", ["not coloured(person, colour=red, part=upper)"]),
    ],
)  # fmt: skip
def test_words_for_colours(said, terms):
    assert [t for t in parse_query(said, load_catalogue()).predicates if "coloured" in t] == terms


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("person in a light orange shirt", '"light orange" is not told from other colours'),
        ("a car in red stops", "said of a person only"),
        ("person in a hat", "only the colours of the upper and the lower body"),
        ("a striped car", "colours of clothes and vehicles alone"),
        ("person in a red car", "not understood"),
    ],
)
def test_what_colours_do_not_say_is_refused(said, why):
    with pytest.raises(InputError, match=why):
        parse_query(said, load_catalogue())


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ("colour=tartan", "no colour 'tartan'"),
        ("colour=red, part=hat", "no part 'hat'"),
        ("part=upper", "parameter colour is missing"),
        ("colour=3", "name of a colour"),
    ],
)
def test_a_wrong_colour_in_a_catalogue_is_refused(given, why):
    with pytest.raises(InputError, match=why):
        check_term(parse_term(f"coloured(person, {given})"), ("person",))
