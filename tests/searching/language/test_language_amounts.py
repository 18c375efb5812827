"""Numbers, units and times of day are exact."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from words_scenes import parsed, state_terms

from scene4d.core.errors import InputError
from scene4d.searching.language import Window

# International yard and pound agreement (1959); the others are definitions of the SI.
METRES = {"m": 1, "metres": 1, "meter": 1, "cm": "1/100", "km": 1000, "kilometers": 1000,
          "ft": "381/1250", "feet": "381/1250", "yards": "1143/1250", "mile": "201168/125",
          "mi": "201168/125"}  # fmt: skip
SECONDS = {"s": 1, "sec": 1, "seconds": 1, "min": 60, "minutes": 60, "h": 3600, "hours": 3600,
           "ms": "1/1000"}  # fmt: skip
SPEEDS = {"m/s": 1, "metres per second": 1, "km/h": "5/18", "kmh": "5/18", "kph": "5/18",
          "kilometres per hour": "5/18", "kilometers an hour": "5/18", "mph": "1397/3125",
          "miles per hour": "1397/3125", "ft/s": "381/1250"}  # fmt: skip
numbers = st.decimals("0.001", "100", places=3).map(lambda d: format(d.normalize(), "f"))


def exactly(number, unit):
    return float(Fraction(number) * Fraction(unit))


@settings(max_examples=6)
@given(numbers, st.sampled_from(sorted(METRES)), st.sampled_from(["", " "]))
def test_distances(number, unit, space):
    wanted = exactly(number, METRES[unit])
    if wanted > 1e4:
        return  # further than the predicate goes
    phase, _ = state_terms(f"person within {number}{space}{unit} of a vehicle")
    assert phase.terms[0].parameters == {"tau_m": wanted}


@settings(max_examples=6)
@given(numbers, st.sampled_from(sorted(SECONDS)), st.sampled_from(["", " "]))
def test_durations(number, unit, space):
    phase, _ = state_terms(f"person near vehicle for more than {number}{space}{unit}")
    assert (phase.min_s, phase.max_s) == (exactly(number, SECONDS[unit]), float("inf"))


@settings(max_examples=6)
@given(numbers, st.sampled_from(sorted(SPEEDS)))
def test_speeds(number, unit):
    wanted = exactly(number, SPEEDS[unit])
    if wanted > 100:
        return
    phase, _ = state_terms(f"vehicle faster than {number} {unit}")
    assert phase.terms[0].predicate == "speed_above"
    assert phase.terms[0].parameters == {"speed_mps": wanted}


@pytest.mark.parametrize(
    ("said", "least", "most"),
    [
        ("for 10 s", 10, None),
        ("for at least 10 s", 10, None),
        ("for over 1 minute and 30 seconds", 90, None),
        ("for 2 h 5 min", 7500, None),
        ("for less than half a minute", 1, 30),
        ("for at most half a second", 0.5, 0.5),
        ("for a minute", 60, None),
        ("for an hour", 3600, None),
        ("for ten minutes", 600, None),
        ("for 5 to 10 minutes", 300, 600),
        ("for between 5 and 10 minutes", 300, 600),
        ("for between half a minute and two minutes", 30, 120),
        ("for 1,000 s", 1000, None),
        ("longer than 2.5 min", 150, None),
        ("for at least 5 s and for at most 8 s", 5, 8),
        ("", 1, None),
    ],
)
def test_ways_to_say_how_long(said, least, most):
    phase, _ = state_terms(f"person near vehicle {said}")
    assert (phase.min_s, phase.max_s) == (least, float("inf") if most is None else most)


@pytest.mark.parametrize(
    "said",
    ["within 3 m of a vehicle", "less than 3 m from a vehicle", "near a vehicle at most 3 m",
     "no more than 3 m from a vehicle", "closer than 3 m to a vehicle",
     "near a vehicle closer than 3 m"],
)  # fmt: skip
def test_ways_to_say_how_near(said):
    assert parsed(f"person is {said}").predicates == ["near(person, vehicle, tau_m=3)"]


@pytest.mark.parametrize(
    ("said", "begin", "end"),
    [
        ("between 14:00 and 15:30", 14 * 3600, 15.5 * 3600),
        ("from 2 pm to 3:30pm", 14 * 3600, 15.5 * 3600),
        ("after 9 pm", 21 * 3600, 86400),
        ("since 21:00:30", 21 * 3600 + 30, 86400),
        ("before 7 a.m.", 0, 7 * 3600),
        ("until noon", 0, 12 * 3600),
        ("between 22:00 and 2:00", 22 * 3600, 2 * 3600),
        ("between 12 am and 12 pm", 0, 12 * 3600),
        ("at midnight", 86400 - 300, 300),
        ("in the morning", 6 * 3600, 12 * 3600),
        ("at night", 22 * 3600, 6 * 3600),
        ("after 9 pm and before 11 pm", 21 * 3600, 23 * 3600),
        ("between 0:00 and 24:00", 0, 86400),
    ],
)
def test_times_of_day(said, begin, end):
    orders = ("{}, vehicle stops", "{} vehicle stops", "vehicle stops, {}", "vehicle stops {}")
    order = orders[int(end) // 60 % 4]
    assert parsed(order.format(said)).window == Window(float(begin), float(end))


@settings(max_examples=10)
@given(st.integers(0, 1439), st.integers(0, 1439), st.integers(0, 1439))
def test_a_window_holds_the_minutes_between(begin, end, minute):
    if begin == end:
        return

    def clock(m):
        return f"{m // 60}:{m % 60:02d}"

    window = parsed(f"vehicle stops between {clock(begin)} and {clock(end)}").window
    after = (minute - begin) % 1440 < (end - begin) % 1440
    assert window.contains(60.0 * minute) == after
    assert window.contains(60.0 * minute + 86400) == after


@pytest.mark.parametrize(
    "said",
    ["after 25:00", "after 9:60", "at 13 pm", "before 0 am", "after 24:01",
     "between 9:00 and 9:00", "before 0:00"],
)  # fmt: skip
def test_times_that_cannot_be(said):
    with pytest.raises(InputError, match="time"):
        parsed(f"person enters vehicle {said}")


@pytest.mark.parametrize(
    "said",
    ["within 0 m", "within -3 m", "within 3,5 m", "within 1.2.3 m", "within 1e3 m",
     "within 99999999999 km", "within 0.00000000000000000000001 m", f"within {'9' * 5000} m",
     "within 20 km", "within 3", "within 3 kg", "for 10 m", "for 10 to 5 s",
     "for between 10 s and 5 s", "for more than 10 s and for less than 5 s"],
)  # fmt: skip
def test_amounts_that_cannot_be(said):
    with pytest.raises(InputError):
        parsed(f"person near vehicle {said}")
