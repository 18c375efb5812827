"""A call that does not fit its annotations is noticed, whatever fitted before it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import beartype
import numpy as np
import pytest
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import Float, TypeCheckError

from type_checks import begin, once

checked = once(typechecker=beartype.beartype)
WRONG = (TypeCheckError, BeartypeCallHintViolation)
ONE, TWO, LARGE, LARGER = np.zeros(1), np.zeros(2), np.zeros(100), np.zeros(200)


@checked
def result_of(given: object, make: Callable) -> Float[np.ndarray, "n 2"]:
    return make(given)


@checked
def with_a_closure(n: int) -> object:
    @checked
    def inner(value: Float[np.ndarray, "2"]) -> int:
        return len(value) + n

    return inner


@checked
def both(a: Float[np.ndarray, "n"], b: Float[np.ndarray, "n"] | None = None) -> None: ...


@checked
def numbered(rows: Sequence[int], *, word: str = "") -> Sequence[int]:
    return rows


@checked
def chosen(word: Literal["one", "two"]) -> None: ...


@checked
def doubled(a: Float[np.ndarray, "n"], b: Float[np.ndarray, "2*n"]) -> None: ...


@checked
def many(*values: int, **named: "str | None") -> None: ...


@checked
@dataclass
class Row:
    values: Float[np.ndarray, "2"]


@pytest.mark.parametrize(
    ("call", "right", "wrong"),
    [
        (both, (ONE, ONE), (ONE, TWO)),
        (both, (TWO, None), (TWO, "two")),
        (both, (TWO, TWO), (TWO, TWO.astype(int))),
        (both, (LARGE, LARGE), (LARGE, LARGER)),
        (both, (LARGE, LARGE), (LARGE, TWO)),
        (doubled, (LARGE, LARGER), (LARGE, np.zeros(300))),
        (many, (1, 2), (1, "2")),
        (numbered, ([1, 2],), (["1", "2"],)),
        (numbered, ((1, 2),), (("1", "2"),)),
        (chosen, ("one",), ("three",)),
        (Row, (TWO,), (ONE,)),
        (with_a_closure(1), (TWO,), (ONE,)),
    ],
)
def test_wrong_arguments_after_right_ones(call, right, wrong):
    for _ in range(2):
        call(*right)
    for _ in range(2):
        with pytest.raises(WRONG):
            call(*wrong)
    call(*right)


def test_wrong_results_after_right_ones():
    results = iter([np.zeros((3, 2)), np.zeros((4, 2)), np.zeros(2), np.zeros((3, 2)), [1.0], None])

    def make(_: object) -> object:
        return next(results)

    for right in (True, True, False, True, False, False):
        if right:
            result_of(1, make)
        else:
            with pytest.raises(WRONG):
                result_of(1, make)


def test_after_many_calls_some_are_looked_at_and_all_in_the_next_test():
    for _ in range(1000):
        both(ONE, ONE)
    let_through = 0
    with pytest.raises(WRONG):
        for let_through in range(16):  # noqa: B007
            both(ONE, TWO)
    assert let_through > 0
    begin()
    with pytest.raises(WRONG):
        both(ONE, TWO)


@pytest.mark.parametrize("named", [{"a": 1}, {"a": "1", "b": 2}])
def test_what_is_named_is_checked(named):
    many(a="1", b=None)
    with pytest.raises(WRONG):
        many(**named)


def test_a_closure_made_anew_computes_with_what_it_closes_over():
    assert [with_a_closure(n)(TWO) for n in (1, 2, 3)] == [3, 4, 5]
    with pytest.raises(WRONG):
        with_a_closure(4)(ONE)


def test_the_package_is_checked():
    from scene4d.core.geometry import rotation_from_tilt_roll

    rotation_from_tilt_roll(0.1, 0.2)
    with pytest.raises(WRONG):
        rotation_from_tilt_roll("0.1", 0.2)
