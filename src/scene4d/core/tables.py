"""Tables of people as Parquet, through arro3.

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
from arro3.io import read_parquet, write_parquet

from scene4d.core.errors import InputError, UnavailableError
from scene4d.core.files import write_bytes

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
    arrow = isinstance(columns, Table)
    return pd.DataFrame.from_arrow(columns) if arrow else pd.DataFrame(dict(columns))


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

    Raises :class:`InputError` for a file that is not Parquet or has missing values.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    # The Rust reader panics on anything that is not Parquet, so check first.
    if len(content) < 12 or not (content.startswith(_MAGIC) and content.endswith(_MAGIC)):
        raise InputError(f"{path}: is not a whole Parquet file")
    try:
        table = read_parquet(io.BytesIO(content)).read_all()
    except BaseException as error:  # its panics are no Exception
        if isinstance(error, Exception) or type(error).__name__ == "PanicException":
            raise InputError(f"{path}: is a damaged Parquet file: {error}") from error
        raise
    return {name: _column(path, name, table) for name in table.column_names}


def _column(path: Path, name: str, table: Table) -> np.ndarray:
    column = table[name]
    if column.null_count:
        raise InputError(f"{path}: column {name!r} has {column.null_count} missing values")
    if column.type == DataType.utf8():
        return np.array(column.to_pylist(), dtype=str)
    if not table.num_rows:  # arro3 cannot join zero chunks; one row of zeros has the type
        empty = Array.from_numpy(np.zeros(1)).cast(column.type)
        return np.asarray(empty.to_numpy())[:0]
    return np.asarray(column.to_numpy())
