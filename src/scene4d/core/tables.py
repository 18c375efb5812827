"""Tables of people as Parquet: written through arro3, read through DuckDB.

arro3 is Rust's Arrow and Parquet in 35 MB; pyarrow does the same in 170 MB of the 600 MB that the
whole installation may take. The files are ordinary Parquet for every other reader.
"""

import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from arro3.core import Array, DataType, Table
from arro3.io import write_parquet

from scene4d.core.errors import InputError, UnavailableError
from scene4d.core.files import write_bytes
from scene4d.core.text import quoted

_MAGIC = b"PAR1"


def arrow_table(columns: Mapping[str, np.ndarray]) -> Table:
    """Arrow columns from 1-D arrays of one length: floats (NaN stays NaN), integers, booleans or
    strings. Raises :class:`InputError` for anything else.
    """
    lengths = {len(values) for values in columns.values() if values.ndim == 1}
    if len(lengths) != 1:
        raise InputError(f"a table needs 1-D columns of one length, found {sorted(lengths)}")
    return Table.from_pydict({name: _arrow(name, values) for name, values in columns.items()})


def data_frame(columns: Mapping[str, Any] | Table) -> Any:
    """The columns as a pandas DataFrame; raises :class:`UnavailableError` without pandas."""
    try:
        import pandas as pd  # type: ignore[import-untyped]
    except ImportError as error:
        raise UnavailableError("to_pandas needs pandas: pip install 'scene4d[pandas]'") from error
    if not isinstance(columns, Table):
        return pd.DataFrame(dict(columns))
    import duckdb  # pandas itself needs pyarrow for this

    with duckdb.connect() as connection:
        frame = connection.from_arrow(columns).df()
    for field in columns.schema:
        if DataType.is_timestamp(field.type) and field.type.tz is not None:
            frame[field.name] = frame[field.name].dt.tz_localize(field.type.tz)
    return frame


def write_people(path: str | os.PathLike[str], columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of equal length to a Parquet file, atomically.

    Raises :class:`InputError` as :func:`arrow_table`, and
    :class:`~scene4d.core.errors.OutputError` where the file cannot be written.
    """
    buffer = io.BytesIO()
    write_parquet(arrow_table(columns), buffer)
    write_bytes(path, buffer.getvalue())


def _arrow(name: str, values: np.ndarray) -> Array:
    if values.ndim != 1 or values.dtype.kind not in "fiubU":
        raise InputError(
            f"column {name!r}: expected a 1-D array of floats, integers, booleans or strings, "
            f"found {values.ndim}-D {values.dtype}"
        )
    if values.dtype.kind == "U":
        return Array(values.tolist(), DataType.utf8())
    return Array.from_numpy(np.ascontiguousarray(values))


def read_table(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The columns of a Parquet file of numbers, booleans and strings, in its order.

    Raises :class:`InputError` for a file that is not Parquet or has missing values. DuckDB reads
    it: arro3 panics on damaged files, which prints a trace that nobody can catch.
    """
    import duckdb

    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) < 12 or not (content.startswith(_MAGIC) and content.endswith(_MAGIC)):
        raise InputError(f"{path}: is not a whole Parquet file")
    try:
        with duckdb.connect() as connection:
            columns = connection.read_parquet(os.fspath(path)).fetchnumpy()
    except (duckdb.Error, RuntimeError) as error:
        raise InputError(f"{path}: is a damaged Parquet file: {quoted(str(error))}") from error
    return {name: _column(path, name, values) for name, values in columns.items()}


def _column(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    missing = int(np.sum(getattr(values, "mask", False)))
    if missing:
        raise InputError(f"{path}: column {quoted(name)} has {missing} missing values")
    plain = np.asarray(values)
    if plain.dtype.kind == "O" and all(isinstance(value, str) for value in plain):
        return np.array(plain.tolist(), dtype=str)
    if plain.dtype.kind not in "fiub":
        raise InputError(
            f"{path}: column {quoted(name)}: expected numbers, booleans or strings, found others"
        )
    return plain
