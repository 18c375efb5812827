"""Parquet tables."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from scene4d.core.errors import InputError, OutputError
from scene4d.core.tables import read_table, write_people

COLUMNS = {
    "x": np.array([1.5, np.nan, -np.inf]),
    "f": np.array([1, 2, 3], np.float32),
    "i": np.array([-1, 2, 2**60]),
    "s": np.array(["person", "", "Müller 人"]),
    "b": np.array([True, False, True]),
}


def test_every_kind_of_column_comes_back(tmp_path):
    write_people(tmp_path / "a.parquet", COLUMNS)
    found = read_table(tmp_path / "a.parquet")
    assert list(found) == list(COLUMNS)
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(found[name], values)
        assert found[name].dtype.kind == values.dtype.kind
    assert [p.name for p in tmp_path.iterdir()] == ["a.parquet"]


@settings(max_examples=25, deadline=None)
@given(
    rows=st.integers(0, 50).flatmap(
        lambda n: st.tuples(
            hnp.arrays(np.float64, n),
            hnp.arrays(np.int64, n),
            hnp.arrays(np.bool_, n),
            st.lists(
                st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])),
                min_size=n,
                max_size=n,
            ),
        )
    )
)
def test_round_trip(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("t") / "a.parquet"
    columns = dict(zip("fib", rows, strict=False)) | {"s": np.array(rows[3], dtype=str)}
    write_people(path, columns)
    found = read_table(path)
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name], values)
        assert found[name].dtype.kind == values.dtype.kind


def test_another_reader_agrees(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_people(tmp_path / "a.parquet", COLUMNS)
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table["s"].to_pylist() == COLUMNS["s"].tolist()
    np.testing.assert_array_equal(table["x"].to_numpy(), COLUMNS["x"])


def test_strided_columns(tmp_path):
    uv = np.arange(8.0).reshape(4, 2)
    write_people(tmp_path / "a.parquet", {"u": uv[:, 0], "v": uv[:, 1]})
    np.testing.assert_array_equal(read_table(tmp_path / "a.parquet")["v"], [1, 3, 5, 7])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({}, "one length"),
        ({"a": np.zeros(2), "b": np.zeros(3)}, "one length"),
        ({"a": np.zeros(2), "b": np.zeros((2, 2))}, "'b'.*2-D"),
        ({"a": np.array([None, 1])}, "'a'.*object"),
    ],
)
def test_bad_columns(tmp_path, columns, message):
    with pytest.raises(InputError, match=message):
        write_people(tmp_path / "a.parquet", columns)
    assert not list(tmp_path.iterdir())


def test_bad_files(tmp_path):
    path = tmp_path / "a.parquet"
    with pytest.raises(InputError, match="cannot be read"):
        read_table(path)
    write_people(path, COLUMNS)
    whole = path.read_bytes()
    for broken in (b"", b"junk", whole[:-20]):
        path.write_bytes(broken)
        with pytest.raises(InputError, match="not a whole Parquet file"):
            read_table(path)
    path.write_bytes(whole[:-60] + b"\xff" * 52 + whole[-8:])
    with pytest.raises(InputError, match="damaged"):
        read_table(path)
    with pytest.raises(OutputError):
        write_people(tmp_path / "missing" / "a.parquet", COLUMNS)
