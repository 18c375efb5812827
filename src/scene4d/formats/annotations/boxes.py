"""The checks that every annotation must pass, and tables of numbers with their line numbers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.errors import InputError
from scene4d.core.people import Detections


@dataclass(frozen=True)
class Rows:
    """What a reader found, before it is checked; ``where(row)`` says where in the file it is."""

    detections: Detections
    where: Callable[[int], str]


def first_fault(rows: Rows) -> tuple[Bool[np.ndarray, "n"], str | None]:
    """Which rows are good, and what is wrong with the first that is not.

    Bad are boxes that are not finite, are empty or swapped, or lie wholly outside the image, and
    frames below 0. Boxes that the border cuts are good.
    """
    box, frame = rows.detections.box_xyxy, rows.detections.frame
    width, height = rows.detections.image_size
    with np.errstate(invalid="ignore"):
        ordered = (box[:, 2] > box[:, 0]) & (box[:, 3] > box[:, 1])
        # Pixel centres lie at integers: the image reaches from -0.5 to width - 0.5.
        inside = (box[:, 2] > -0.5) & (box[:, 3] > -0.5)
        inside &= (box[:, 0] < width - 0.5) & (box[:, 1] < height - 0.5)
    rules = (
        (np.isfinite(box).all(axis=1), "is not finite; expected four numbers"),
        (ordered, "is empty or swapped; expected x1 < x2 and y1 < y2"),
        (inside, f"lies wholly outside the {width}x{height} image; is the image size right?"),
        (frame >= 0, "has a negative frame number; expected 0 or more"),
    )
    good = np.logical_and.reduce([rule for rule, _ in rules])
    if good.all():
        return good, None
    first = int(np.argmin(good))
    reason = next(text for rule, text in rules if not rule[first])
    corners = ", ".join(f"{x:g}" for x in box[first])
    return good, f"{rows.where(first)}: box (x1, y1, x2, y2) = ({corners}) {reason}"


def numeric_table(
    text: str, least_columns: int
) -> tuple[Float[np.ndarray, "n c"], Int[np.ndarray, "n"]]:
    """Rows of numbers separated by commas, semicolons or blanks, and the line of each row.

    Blank lines and what follows ``#`` are skipped. Raises :class:`InputError` naming the line of
    the first token that is no number, and where the count of columns changes.
    """
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    numbers = np.array([n for n, line in enumerate(lines, start=1) if line], dtype=np.int64)
    rows = [line for line in lines if line]
    if not rows:
        raise InputError("the file holds no rows of numbers")
    delimiter = next((d for d in ",;" if d in rows[0]), None)
    try:
        table = np.loadtxt(rows, delimiter=delimiter, ndmin=2, comments=None)
    except ValueError as error:
        raise _culprit(rows, numbers, delimiter) from error
    if table.shape[1] < least_columns:
        raise InputError(
            f"line {numbers[0]}: expected at least {least_columns} columns, found {table.shape[1]}"
        )
    return table, numbers


def _culprit(rows: list[str], numbers: np.ndarray, delimiter: str | None) -> InputError:
    columns = len(rows[0].split(delimiter))
    for row, number in zip(rows, numbers, strict=True):
        tokens = row.split(delimiter)
        if len(tokens) != columns:
            return InputError(f"line {number}: expected {columns} columns, found {len(tokens)}")
        for token in tokens:
            try:
                float(token)
            except ValueError:
                return InputError(f"line {number}: expected a number, found {token.strip()!r}")
    return InputError("is not a table of numbers")


def whole(
    values: Float[np.ndarray, "n"], name: str, where: Callable[[int], str]
) -> Int[np.ndarray, "n"]:
    """A column as integers. Raises :class:`InputError` for a value that is no whole number."""
    good = np.isfinite(values) & (np.abs(values) < 2.0**53)
    good &= np.where(good, np.floor(values) == values, False)
    if not good.all():
        first = int(np.argmin(good))
        raise InputError(f"{where(first)}: {name} must be a whole number, found {values[first]:g}")
    return values.astype(np.int64)
