"""Ground points as a table: CSV with a header."""

import csv
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.core.text import floats, in_file, quoted, read_text

NEEDED = ("u", "v", "x_m", "y_m")
OPTIONAL = ("z_m", "sigma_m", "sigma_px", "name")


def is_table(path: Path) -> bool:
    """Whether the file is named as a table."""
    return path.suffix.lower() in (".csv", ".tsv", ".txt")


def table_rows(path: Path) -> list[tuple[str, dict[str, float]]]:
    """Name and numbers of every row, by columns; empty cells are left out. Columns are separated by
    commas, semicolons or tabs.

    Raises :class:`InputError` naming the file and the line.
    """
    with in_file(path):
        return _rows(read_text(path))


def _rows(text: str) -> list[tuple[str, dict[str, float]]]:
    head = text.lstrip().partition("\n")[0]
    reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=head.count))
    columns: list[str] | None = None
    found = []
    for cells in reader:
        where, words = f"line {reader.line_num}", [cell.strip() for cell in cells]
        if not any(words):
            continue
        if columns is None:
            columns = _columns(words, where)
            continue
        if len(words) != len(columns):
            raise InputError(f"{where}: expected {len(columns)} cells, found {len(words)}")
        row = {name: word for name, word in zip(columns, words, strict=True) if word}
        missing = [name for name in NEEDED if name not in row]
        if missing:
            raise InputError(f"{where}: {missing[0]} is empty")
        name = row.pop("name", "")
        numbers = floats(row.values(), where)
        found.append((name, dict(zip(row, numbers.tolist(), strict=True))))
    return found


def _columns(words: list[str], where: str) -> list[str]:
    columns = [word.lower() for word in words]
    unknown = [name for name in columns if name not in (*NEEDED, *OPTIONAL)]
    if unknown or len(set(columns)) < len(columns) or not set(NEEDED) <= set(columns):
        raise InputError(
            f"{where}: expected a header with the columns {', '.join(NEEDED)}, and of "
            f"{', '.join(OPTIONAL)} those that are known, found {quoted(','.join(words))}"
        )
    return columns
