"""Numbers with units, exact until they are rounded once."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from scene4d.searching.language.words import refuse

_MOST = 10**9
"""No distance, duration or speed is larger, in metres and seconds."""


@dataclass(frozen=True)
class Amount:
    """A distance, duration or speed (``kind``) in metres and seconds, and the size of its last
    unit in these.
    """

    kind: str
    value: float
    unit: Fraction


def read_number(word: str, text: str, start: int) -> Fraction:
    """A number in digits: "3", "3.5", "1,000". Raises :class:`InputError` for other forms."""
    if "," in word and not re.fullmatch(r"\d{1,3}(,\d{3})+(\.\d+)?", word):
        raise refuse(text, start, f'"{word}": write decimals with a point')
    if word.count(".") > 1:
        raise refuse(text, start, f'"{word}" is no number')
    return Fraction(word.replace(",", ""))


def amount_of(kind: str, parts: Sequence[Fraction], text: str, span: tuple[int, int]) -> Amount:
    """The sum of numbers times units, which ``parts`` holds in turn. Raises :class:`InputError`
    where it is nothing, or too much.
    """
    total = sum((n * u for n, u in zip(parts[::2], parts[1::2], strict=True)), Fraction(0))
    said = text[slice(*span)]
    if total > _MOST:
        raise refuse(text, span[0], f'"{said}" is too much for a {kind}')
    if float(total) == 0:
        raise refuse(text, span[0], f'"{said}": a {kind} must be more than nothing')
    return Amount(kind, float(total), parts[-1])
