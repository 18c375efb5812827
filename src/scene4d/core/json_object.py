"""JSON objects from untrusted files: every field is read with a type check."""

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.text import quoted

_LARGEST_INTEGER = 2**53
"""Larger integers change in programs that read JSON numbers as floats."""


class JsonObject:
    """The fields of one JSON object; a field that is null counts as missing.

    Every method raises :class:`InputError` that names the file, the field (``sigma.focal_px``),
    what was found, and what was expected.
    """

    def __init__(self, values: Any, where: str, inside: str = "") -> None:
        self.where, self._inside = where, inside
        if not isinstance(values, dict):
            what = f"field {inside[:-1]!r} " if inside else ""
            raise InputError(f"{where}: {what}must be an object, found {quoted(values)}")
        self._values = values

    @classmethod
    def read(cls, path: str | os.PathLike[str], *schemas: str) -> "JsonObject":
        """The object in a file, which must have one of the ``schemas`` if any are given."""
        values, where = read_json(path), os.fspath(path)
        found = values.get("schema") if isinstance(values, dict) else None
        if schemas and found not in schemas:
            raise InputError(
                f'{where}: field "schema" must be {" or ".join(map(repr, schemas))}, '
                f"found {quoted(found)}"
            )
        return cls(values, where)

    def __contains__(self, name: str) -> bool:
        return self._values.get(name) is not None

    def error(self, name: str, expected: str) -> InputError:
        """The error of a field that is not as expected."""
        field = f"{self.where}: field {self._inside + name!r}"
        if name not in self:
            return InputError(f"{field} is missing: it must be {expected}")
        return InputError(f"{field} must be {expected}, found {quoted(self._values[name])}")

    def only(self, known: Iterable[str]) -> None:
        """Reject fields with any other name: a mistyped one would be ignored."""
        known = tuple(known)
        unknown = sorted(set(self._values) - set(known))
        if unknown:
            raise InputError(
                f"{self.where}: unknown field {quoted(self._inside + unknown[0])}; "
                f"known: {', '.join(known)}"
            )

    def names(self) -> list[str]:
        """The names of the fields present."""
        return [name for name in self._values if name in self]

    def value(self, name: str) -> Any:
        """The field's value of any type; None if missing."""
        return self._values.get(name)

    def text(self, name: str) -> str:
        """A text."""
        value = self.value(name)
        if not isinstance(value, str):
            raise self.error(name, "a text")
        return value

    def flag(self, name: str) -> bool:
        """True or false."""
        value = self.value(name)
        if not isinstance(value, bool):
            raise self.error(name, "true or false")
        return value

    def number(
        self, name: str, *, least: float = -np.inf, above: float = -np.inf, most: float = np.inf
    ) -> float:
        """A finite number of at least ``least``, greater than ``above``, and at most ``most``."""
        value = _finite(self.value(name))
        if value is None or not (value >= least and value > above and value <= most):
            raise self.error(name, _range("a number", least, above, most))
        return value

    def integer(self, name: str, *, least: int = -_LARGEST_INTEGER) -> int:
        """A whole number of at least ``least``."""
        value = self.value(name)
        if type(value) is not int or not least <= value <= _LARGEST_INTEGER:
            raise self.error(name, _range("a whole number", float(least), -np.inf, np.inf))
        return value

    def array(self, name: str, *shape: int | None) -> Float[np.ndarray, "..."]:
        """Finite numbers in lists of lists of this shape; None stands for any length."""
        found = _array(self.value(name), len(shape))
        if found is None or any(
            n not in (None, m) for n, m in zip(shape, found.shape, strict=True)
        ):
            size = "x".join("n" if n is None else str(n) for n in shape)
            raise self.error(name, f"{size} finite numbers")
        return found

    def texts(self, name: str) -> tuple[str, ...]:
        """A list of texts."""
        value = self.value(name)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.error(name, "a list of texts")
        return tuple(value)

    def object(self, name: str) -> "JsonObject":
        """An object within this one."""
        if name not in self:
            raise self.error(name, "an object")
        return JsonObject(self.value(name), self.where, f"{self._inside}{name}.")

    def objects(self, name: str) -> "list[JsonObject]":
        """A list of objects."""
        value = self.value(name)
        if not isinstance(value, list):
            raise self.error(name, "a list of objects")
        inside = f"{self._inside}{name}"
        return [JsonObject(item, self.where, f"{inside}[{i}].") for i, item in enumerate(value)]


def _finite(value: Any) -> float | None:
    """A JSON number as a float; None if it is not a number, not finite, or too large (10^400)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if np.isfinite(number) else None


def _array(value: Any, depth: int) -> np.ndarray | None:
    """Lists of lists of finite numbers; None for anything else, also for rows of unequal length."""
    if depth == 0:
        number = _finite(value)
        return None if number is None else np.array(number)
    if not isinstance(value, list):
        return None
    rows = [_array(item, depth - 1) for item in value]
    if any(row is None for row in rows) or len({row.shape for row in rows if row is not None}) > 1:
        return None
    return np.array(rows, float) if rows else np.empty((0,) * depth)


def _range(what: str, least: float, above: float, most: float) -> str:
    limits = [
        f"{word} {limit:g}"
        for word, limit in (("at least", least), ("greater than", above), ("at most", most))
        if np.isfinite(limit) and abs(limit) < _LARGEST_INTEGER
    ]
    return f"{what}, {' and '.join(limits)}" if limits else what
