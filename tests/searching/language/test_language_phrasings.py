"""Searches as analysts type them, against what they must mean (benchmarks/language.txt)."""

import pytest
from benchmarks.language import REFUSED, RIGHT, WRONG, Phrasing, analysts, phrasings, third

SHARE = 8
"""One in so many is tried here, for the time it takes; ``benchmarks.language`` tries all."""


@pytest.mark.parametrize("those", [phrasings(False), phrasings(True), analysts(), third()])
def test_most_are_right_and_none_is_silently_wrong(those):
    some = those[::SHARE]
    scores = [(one.text, *one.score()) for one in some]
    wrong = [(text, said) for text, how, said in scores if how == WRONG]
    assert wrong == []
    assert sum(how == RIGHT for _, how, _ in scores) >= 0.85 * len(some)


def test_there_are_enough_of_them_and_each_once():
    texts = [one.text for held_out in (False, True) for one in phrasings(held_out)]
    assert len(texts) == len(set(texts)) >= 150
    assert len(phrasings(True)) >= len(texts) // 3


@pytest.mark.parametrize(
    ("text", "expected", "how"),
    [
        ("person near a car", "near(person, car)", RIGHT),
        ("person near a car", "near(person, vehicle)", WRONG),
        ("person near a car", "near(car, person)", RIGHT),
        ("person moves towards a car", "moving_towards(car, person)", WRONG),
        ("person near a car", "near(person, car) & stationary(car)", WRONG),
        ("person near a car for 5 s", "near(person, car)", WRONG),
        ("person near a car for 5 s", "near(person, car) 5..", RIGHT),
        ("person within 3 m of a car", "near(person, car, tau_m=2)", WRONG),
        ("three people near a car", "near(person, car)", WRONG),
        ("vehicle stops after 9 pm", "@vehicle_stops(vehicle)", WRONG),
        ("vehicle stops after 9 pm", "@vehicle_stops(vehicle) [21:00-24:00]", RIGHT),
        ("person enters vehicle", "@person_exits_vehicle(person, vehicle)", WRONG),
        ("vehicle stops then within 5 s it starts",
         "@vehicle_stops(vehicle) ; @vehicle_starts(vehicle) <=9", WRONG),
        ("a striped car stops", "! colour", RIGHT),
        ("a striped car stops", "@vehicle_stops(car)", REFUSED),
    ],
)  # fmt: skip
def test_the_comparison_tells_what_differs(text, expected, how):
    assert Phrasing(text, expected).score()[0] == how
