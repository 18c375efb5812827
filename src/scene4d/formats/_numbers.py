"""Numbers in text files: tables with the line of each row, and single matrices."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.text import floats, in_file, quoted, read_text

_SEPARATORS = re.compile(r"[\s,;]+")
_LARGEST_INTEGER = 2.0**53  # beyond it, not every whole number is a float


@contextmanager
def sane_numbers(path: Path, kind: str) -> Iterator[None]:
    """Errors of what is read in the block name the file, also where its numbers overflow."""
    try:
        with in_file(path), np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise InputError(f"{path}: its numbers are too large or too small for a {kind}") from error


def lines_of(text: str, comments: tuple[str, ...] = ()) -> Iterator[tuple[str, str]]:
    """Where each line is, as ``line 3``, and the line, but blank ones and ``comments``."""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith(comments):
            yield f"line {number}", line


def check_rows(
    good: Bool[np.ndarray, "n"], where: Sequence[str], wrong: Callable[[int], str]
) -> None:
    """Raise :class:`InputError` that says where the first row is that is not ``good``, and what is
    ``wrong`` there.
    """
    if not good.all():
        first = int(np.argmin(good))
        raise InputError(f"{where[first]}: {wrong(first)}")


def numeric_table(text: str, least_columns: int) -> tuple[Float[np.ndarray, "n c"], list[str]]:
    """Rows of numbers separated by commas, semicolons or blanks, and where each row is.

    Blank lines and what follows ``#`` are skipped. Raises :class:`InputError` naming the line of
    the first token that is no number, and where the count of columns changes.
    """
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    where = [f"line {n}" for n, line in enumerate(lines, start=1) if line]
    rows = [line for line in lines if line]
    if not rows:
        raise InputError("the file holds no rows of numbers")
    delimiter = next((d for d in ",;" if d in rows[0]), None)
    try:
        table = np.loadtxt(rows, delimiter=delimiter, ndmin=2, comments=None)
    except ValueError as error:
        raise _culprit(rows, where, delimiter) from error
    if table.shape[1] < least_columns:
        raise InputError(
            f"{where[0]}: expected at least {least_columns} columns, found {table.shape[1]}"
        )
    return table, where


def _culprit(rows: list[str], where: list[str], delimiter: str | None) -> InputError:
    columns = len(rows[0].split(delimiter))
    for row, at in zip(rows, where, strict=True):
        tokens = row.split(delimiter)
        if len(tokens) != columns:
            return InputError(f"{at}: expected {columns} columns, found {len(tokens)}")
        wrong = next((token for token in tokens if not all_numbers([token])), None)
        if wrong is not None:
            return InputError(f"{at}: expected a number, found {quoted(wrong.strip())}")
    return InputError("is not a table of numbers")


def whole(values: Float[np.ndarray, "n"], name: str, where: Sequence[str]) -> Int[np.ndarray, "n"]:
    """A column as integers; ``where`` each of them is.

    Raises :class:`InputError` for a value that is no whole number.
    """
    good = np.isfinite(values) & (np.abs(values) < _LARGEST_INTEGER)
    good &= np.where(good, np.floor(values) == values, False)
    check_rows(good, where, lambda row: f"{name} must be a whole number, found {values[row]:g}")
    return values.astype(np.int64)


def all_numbers(tokens: Iterable[str]) -> bool:
    """Whether ``float`` reads every one."""
    try:
        for token in tokens:
            float(token)
    except ValueError:
        return False
    return True


def words(text: str) -> list[tuple[int, str]]:
    """Every word with its line; blanks, commas and semicolons separate, ``#`` begins a comment."""
    return [
        (number, word)
        for number, line in enumerate(text.splitlines(), start=1)
        for word in _SEPARATORS.split(line.partition("#")[0])
        if word
    ]


def read_matrix(path: Path, rows: int, columns: int, kind: str) -> Float[np.ndarray, "r c"]:
    """A file of one matrix, row by row: text as :func:`words` reads it, or JSON lists.

    A JSON object must have exactly one field of this shape. Raises :class:`InputError` naming the
    line or field of what is no number, and for another count of numbers.
    """
    text = read_text(path)
    if is_json(text):
        where, values = _json_matrix(read_json(path), rows, columns)
        found = floats(flat(values), where)
    else:
        tokens = words(text)
        found = np.array([floats([token], f"line {n}")[0] for n, token in tokens])
        line = tokens[min(rows * columns, len(tokens) - 1)][0] if tokens else 1
        where = f"line {line}"
    if len(found) != rows * columns:
        raise InputError(
            f"{where}: expected the {rows * columns} numbers of a {rows}x{columns} {kind}, "
            f"found {len(found)}"
        )
    return found.reshape(rows, columns)


def _json_matrix(values: Any, rows: int, columns: int) -> tuple[str, Any]:
    if not isinstance(values, dict):
        return "JSON", values
    fields = matrix_fields(values, rows, columns)
    if len(fields) != 1:
        found = ", ".join(map(quoted, fields[:3])) or "none"
        raise InputError(
            f"expected one field that is a {rows}x{columns} list of numbers, found {found}"
        )
    return f"field {quoted(fields[0])}", values[fields[0]]


def is_json(text: str) -> bool:
    """Whether the text looks like a JSON object or list."""
    return text.lstrip()[:1] in ("[", "{")


def flat(value: Any) -> list[object]:
    """The entries of a list of lists (or of a plain list), row by row."""
    out: list[object] = []
    for row in value if isinstance(value, list) else []:
        out.extend(row if isinstance(row, list) else [row])
    return out


def matrix_fields(values: dict[str, Any], rows: int, columns: int) -> list[str]:
    """Names of the fields that are lists of this shape."""
    return [
        name
        for name, value in values.items()
        if isinstance(value, list)
        and [len(row) if isinstance(row, list) else 0 for row in value] == [columns] * rows
    ]
