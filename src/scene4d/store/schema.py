"""The columns of a scene, and their conversion from :class:`~scene4d.core.tracks.Tracks`.

The files hold no NaN: unknown values are null, so that ``avg``, ``min`` and ``count`` of any SQL
engine, and the statistics by which readers skip row groups, are correct. Floats are stored as
float64, keypoints as float32, which resolves 0.0003 pixels in an image 4096 wide.
"""

import io
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from arro3.core import Array, DataType, Field, Table, list_array, list_flatten, list_offsets
from arro3.io import write_parquet
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES, Tracks

SCENE_SCHEMA = "scene4d/scene/1"
"""Name and version of the format written here, and the only one that is read."""
RUN_TRACKS = 10**9
"""Track numbers reserved for each run: the n-th run of a scene begins at n times this."""
_ROWS_PER_GROUP = 32_768
"""Rows that Parquet readers can skip at once."""
_COLOUR_DECIMALS = 4
LONGEST_S = 2e9
"""Footage is shorter than this; 64 bits of nanoseconds hold 9e9 s."""
_NS = 1_000_000_000


@dataclass(frozen=True)
class Column:
    """One column of a scene: its name, Arrow type, unit, and whether it can be null."""

    name: str
    type: str
    unit: str
    nullable: bool = True


COLUMNS: tuple[Column, ...] = (
    Column("camera", "dictionary<int32, string>", "", nullable=False),
    Column("track", "int64", "", nullable=False),
    Column("class", "dictionary<int32, string>", "", nullable=False),
    Column("time", "timestamp[ns, UTC]", "", nullable=False),
    Column("time_s", "float64", "s from the clip's start", nullable=False),
    Column("frame", "int64", "from 0", nullable=False),
    Column("x_m", "float64", "m"),
    Column("y_m", "float64", "m"),
    Column("var_xx", "float64", "m²"),
    Column("var_xy", "float64", "m²"),
    Column("var_yy", "float64", "m²"),
    Column("shared_xx", "float64", "m²"),
    Column("shared_xy", "float64", "m²"),
    Column("shared_yy", "float64", "m²"),
    Column("vx_mps", "float64", "m/s"),
    Column("vy_mps", "float64", "m/s"),
    Column("var_vxx", "float64", "m²/s²"),
    Column("var_vxy", "float64", "m²/s²"),
    Column("var_vyy", "float64", "m²/s²"),
    Column("heading_rad", "float64", "rad, from +X to +Y"),
    Column("heading_sigma_rad", "float64", "rad"),
    Column("x1", "float64", "px of the footage"),
    Column("y1", "float64", "px of the footage"),
    Column("x2", "float64", "px of the footage"),
    Column("y2", "float64", "px of the footage"),
    Column("keypoint_u", "list<float32>", "px of the footage"),
    Column("keypoint_v", "list<float32>", "px of the footage"),
    Column("keypoint_score", "list<float32>", "0 to 1"),
    Column("score", "float64", "0 to 1"),
    Column("observed", "bool", "", nullable=False),
    Column("existence_probability", "float64", "0 to 1"),
    Column("z_m", "float64", "m"),
    Column("z_sigma_m", "float64", "m"),
    Column("length_m", "float64", "m"),
    Column("width_m", "float64", "m"),
    Column("height_m", "float64", "m"),
    Column("length_sigma_m", "float64", "m"),
    Column("width_sigma_m", "float64", "m"),
    Column("height_sigma_m", "float64", "m"),
    Column("colours", "list<float32>", "0 to 1"),
)
"""The columns of a scene, in order. ``var_`` is the independent part of a covariance, ``shared_``
the part due to calibration error, common to all rows. ``time`` is UTC, counted from 1970-01-01 if
the footage's start is unknown. Positions are on the ground in the camera's metres, Z up.
``existence_probability`` and the sizes are a track's, as known when the row became final; ``z_m``
is the height of the ground under it, so that its centroid is at ``z_m + height_m / 2``. ``colours``
are a track's too: probabilities of :data:`.colours.PALETTE` for the upper body, or for a vehicle's,
and then for the lower body; a half of zeros is of what was not seen, null of both. New columns
come last and can be null: runs written without them are read as if they were null."""
COLUMN_NAMES: tuple[str, ...] = tuple(column.name for column in COLUMNS)
KEYPOINT_COLUMNS: tuple[str, ...] = ("keypoint_u", "keypoint_v", "keypoint_score")
COLOURS = "colours"
GROUPS: Mapping[str, tuple[str, ...]] = {
    "velocity": ("vx_mps", "vy_mps", "var_vxx", "var_vxy", "var_vyy"),
    "heading": ("heading_rad", "heading_sigma_rad"),
    "box": ("x1", "y1", "x2", "y2"),
    "size": (
        *("length_m", "width_m", "height_m"),
        *("length_sigma_m", "width_sigma_m", "height_sigma_m"),
    ),
    "keypoint": KEYPOINT_COLUMNS,
    COLOURS: (COLOURS,),
}
"""Columns that belong together, under what the names of their fields in :class:`Tracks` begin
with."""
_LIST = "list<float32>"


def _arrow_type(column: Column) -> DataType:
    """The Arrow type that a column's ``type`` names."""
    types = {
        "int64": DataType.int64(),
        "float64": DataType.float64(),
        "bool": DataType.bool(),
        # 32 bits, as pyarrow infers from the folder camera=NAME; otherwise it rejects the file.
        "dictionary<int32, string>": DataType.dictionary(DataType.int32(), DataType.utf8()),
        "timestamp[ns, UTC]": DataType.timestamp("ns", tz="UTC"),
        _LIST: DataType.list(Field("element", DataType.float32(), nullable=True)),
    }
    return types[column.type]


def time_ns(time_s: Float[np.ndarray, "n"], start_ns: int) -> np.ndarray:
    """Nanoseconds since 1970 of seconds from the clip's start, (n,) int64."""
    whole = np.floor(time_s)  # separate, since 1e9 s in ns does not fit a float
    parts = np.rint((time_s - whole) * _NS).astype(np.int64)
    total: np.ndarray = start_ns + whole.astype(np.int64) * _NS + parts
    return total


def check_tracks(tracks: Tracks) -> None:
    """Raise :class:`InputError` for rows that a scene cannot hold, naming the first of them."""
    reasons = (
        (~np.isin(tracks.class_name, CLASSES), "class_name", f"one of {', '.join(CLASSES)}"),
        (~(np.abs(tracks.time_s) < LONGEST_S), "time_s", f"seconds below {LONGEST_S:.0e}"),
        (~((tracks.track >= 0) & (tracks.track < RUN_TRACKS)), "track", f"0 to {RUN_TRACKS - 1}"),
    )
    for bad, name, expected in reasons:
        if bad.any():
            row = int(np.argmax(bad))
            found = getattr(tracks, name)[row].item()
            raise InputError(f"tracks: row {row}: {name} is {found!r}, expected {expected}")


def to_table(tracks: Tracks, *, camera: str, start_ns: int, track_base: int) -> Table:
    """Arrow columns of checked tracks: :data:`COLUMNS`, with null for NaN.

    ``track_base`` is added to the track numbers. Keypoints are null where a row has none: no
    position known and no score above 0.
    """
    n = len(tracks)
    nulls = _Nulls()
    columns = {
        "camera": _words(np.zeros(n, np.uint8), (camera,)),
        "track": Array.from_numpy(tracks.track.astype(np.int64) + track_base),
        "class": _words(*_codes(tracks.class_name)),
        "time": Array.from_numpy(time_ns(tracks.time_s, start_ns)),
        "frame": Array.from_numpy(tracks.frame.astype(np.int64)),
        "observed": Array.from_numpy(np.ascontiguousarray(tracks.observed)),
    }
    flat = tracks.columns()
    for name in (c.name for c in COLUMNS if c.type == "float64"):
        columns[name] = nulls.put(np.ascontiguousarray(flat[name], np.float64))
    columns |= _keypoints(tracks) | {COLOURS: _colours(tracks)}
    # Types by cast: NumPy has neither time zones nor dictionaries.
    typed = {c.name: columns[c.name].cast(_arrow_type(c)) for c in COLUMNS}
    return Table.from_pydict(typed)


def to_parquet(tracks: Tracks, *, camera: str, start_ns: int, track_base: int) -> bytes:
    """The Parquet file of checked tracks; see :func:`to_table`."""
    table = to_table(tracks, camera=camera, start_ns=start_ns, track_base=track_base)
    # Bytes of equal significance together: zstd compresses floats better this way.
    names: list[Any] = [c.name for c in COLUMNS if c.type == "float64"]
    names += [(name, "list", "element") for name in KEYPOINT_COLUMNS]
    buffer = io.BytesIO()
    write_parquet(
        table,
        buffer,
        compression="zstd(1)",
        max_row_group_size=_ROWS_PER_GROUP,
        key_value_metadata={"scene4d.schema": SCENE_SCHEMA},
        column_encoding=dict.fromkeys(names, "byte_stream_split"),
        column_dictionary_enabled=dict.fromkeys(names, False),
    )
    return buffer.getvalue()


def as_stored(tracks: Tracks) -> Tracks:
    """Keypoints in the precision of the files: half the memory and copying."""
    uv, score = tracks.keypoint_uv.astype(np.float32), tracks.keypoint_score.astype(np.float32)
    return replace(tracks, keypoint_uv=uv, keypoint_score=score)


def with_keypoints(tracks: Tracks, k: int) -> Tracks:
    """Give rows without a skeleton ``k`` unseen keypoints."""
    n = len(tracks)
    if tracks.keypoint_uv.shape[1] == k:
        return tracks
    uv, score = np.full((n, k, 2), np.nan, np.float32), np.zeros((n, k), np.float32)
    return replace(tracks, keypoint_uv=uv, keypoint_score=score)


def from_table(table: Table, rows: Int[np.ndarray, "m"] | None = None) -> Tracks:
    """Tracks from Arrow columns in which null is already replaced by NaN, and no list is null: of
    the given rows in their order, or of all.

    Columns missing from the table (but times and positions) are unknown. ``class``
    may be the index in :data:`CLASSES`. A row without keypoints gets NaN for their positions and 0
    for their scores; covariances are symmetric. Raises :class:`InputError` if rows have different
    skeletons.
    """
    taken: Any = slice(None) if rows is None else rows
    n = table.num_rows if rows is None else len(rows)
    there = set(table.column_names)

    places = _places(table, rows)

    def column(name: str, into: np.ndarray | None = None) -> np.ndarray:
        # Chunk by chunk to where it belongs: whole columns would be copied once more.
        for chunk, (kept, place) in zip(table[name].chunks, places, strict=True):
            values = np.asarray(chunk.to_numpy())
            into = np.empty(n, values.dtype) if into is None else into
            into[place] = values[kept]
        return _numpy(table, name) if into is None else into

    def columns(*names: str) -> np.ndarray:
        if names[0] not in there or all(_is_unknown(table, name) for name in names):
            return np.broadcast_to(np.nan, (n, len(names)))
        found = np.empty((n, len(names)))
        for one, name in enumerate(names):
            if name in names[:one]:
                found[:, one] = found[:, names.index(name)]
            else:
                column(name, found[:, one])
        return found

    def matrices(prefix: str) -> np.ndarray:
        return columns(*(prefix + name for name in ("xx", "xy", "xy", "yy"))).reshape(-1, 2, 2)

    u, v, keypoint_score = (
        _lists(table, name, 0.0 if name == "keypoint_score" else np.nan)[taken]
        if name in there
        else np.zeros((n, 0))
        for name in KEYPOINT_COLUMNS
    )
    colours = _lists(table, COLOURS, 0.0)[taken] if COLOURS in there else np.zeros((n, 0))
    return Tracks(
        track=column("track"),
        class_name=_class_names(table, taken),
        time_s=column("time_s"),
        frame=column("frame"),
        xy_m=columns("x_m", "y_m"),
        covariance_m2=matrices("var_"),
        shared_covariance_m2=matrices("shared_"),
        velocity_mps=columns("vx_mps", "vy_mps"),
        velocity_covariance=matrices("var_v"),
        heading_rad=columns("heading_rad")[:, 0],
        heading_sigma_rad=columns("heading_sigma_rad")[:, 0],
        box_xyxy=columns("x1", "y1", "x2", "y2"),
        keypoint_uv=np.stack([u, v], axis=-1),
        keypoint_score=keypoint_score,
        score=columns("score")[:, 0],
        observed=column("observed"),
        existence_probability=columns("existence_probability")[:, 0],
        z_m=columns("z_m")[:, 0],
        z_sigma_m=columns("z_sigma_m")[:, 0],
        size_m=columns("length_m", "width_m", "height_m"),
        size_sigma_m=columns("length_sigma_m", "width_sigma_m", "height_sigma_m"),
        colours=colours.astype(np.float32),
    )


def _is_unknown(table: Table, name: str) -> bool:
    return all(np.isnan(np.asarray(chunk.to_numpy())).all() for chunk in table[name].chunks)


def _places(table: Table, rows: Int[np.ndarray, "m"] | None) -> list[tuple[Any, Any]]:
    """For each chunk of a table which of its rows are taken, and what numbers they then have."""
    ends = np.cumsum([0, *map(len, table["track"].chunks)]).tolist()
    parts = [slice(*span) for span in itertools.pairwise(ends)]
    if rows is None:
        return [(slice(None), part) for part in parts]
    place = np.full(table.num_rows, -1)
    place[rows] = np.arange(len(rows))
    if len(rows) == len(place):
        return [(slice(None), place[part]) for part in parts]
    kept = [np.flatnonzero(place[part] >= 0) for part in parts]
    return [(some, place[part][some]) for some, part in zip(kept, parts, strict=True)]


def _class_names(table: Table, taken: Any) -> np.ndarray:
    """The class names, with a string width that just fits those that occur."""
    column = table["class"]
    if column.type != DataType.int8():
        return np.array(column.to_pylist(), dtype=str)[taken]
    code = _numpy(table, "class")[taken]
    there = np.flatnonzero(np.bincount(code, minlength=len(CLASSES)))
    place = np.zeros(len(CLASSES), np.intp)
    place[there] = np.arange(len(there))
    return np.array([CLASSES[one] for one in there.tolist()], dtype=str)[place[code]]


class _Nulls:
    """Replaces NaN by null.

    arro3 cannot make nulls from NumPy arrays directly, but two of its kernels together can:
    casting NaN to an integer gives null, and taking the row number null gives null.
    """

    def __init__(self) -> None:
        self._missing = np.zeros(0, bool)
        self._rows: Array | None = None

    def put(self, values: np.ndarray) -> Array:
        missing = np.isnan(values)
        column = Array.from_numpy(values)
        if not missing.any():
            return column
        # Related columns miss the same rows.
        if self._rows is None or not np.array_equal(missing, self._missing):
            rows = np.where(missing, np.nan, np.arange(len(values)))
            self._missing, self._rows = missing, Array.from_numpy(rows).cast(DataType.uint32())
        return column.take(self._rows)


def _codes(class_name: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    order = np.argsort(CLASSES)
    codes = order[np.searchsorted(CLASSES, class_name, sorter=order)]
    return codes.astype(np.uint8), CLASSES


def _words(codes: np.ndarray, words: tuple[str, ...]) -> Array:
    return Array(list(words), DataType.utf8()).take(Array.from_numpy(codes))


def _keypoints(tracks: Tracks) -> dict[str, Array]:
    k = tracks.keypoint_uv.shape[1]
    u, v = tracks.keypoint_uv[:, :, 0], tracks.keypoint_uv[:, :, 1]
    score = tracks.keypoint_score
    none = (np.isnan(u) & np.isnan(v) & ~(score > 0)).all(axis=1)
    offsets = np.concatenate([[0], np.cumsum(np.where(none, 0, k))])
    nulls = _Nulls()
    columns = {}
    for name, values in zip(KEYPOINT_COLUMNS, (u, v, score), strict=True):
        content = nulls.put(values[~none].astype(np.float32, copy=False).ravel())
        columns[name] = _list_array(offsets, content, none)
    return columns


def _colours(tracks: Tracks) -> Array:
    none = np.asarray(~(tracks.colours > 0).any(axis=1))
    offsets = np.concatenate([[0], np.cumsum(np.where(none, 0, tracks.colours.shape[1]))])
    content = np.round(tracks.colours[~none].astype(np.float32), _COLOUR_DECIMALS).ravel()
    return _list_array(offsets, Array.from_numpy(content), none)


def _list_array(offsets: Int[np.ndarray, "m"], content: Array, none: np.ndarray) -> Array:
    return list_array(
        Array.from_numpy(offsets.astype(np.int32)),
        content,
        type=DataType.list(Field("element", DataType.float32(), nullable=True)),
        mask=Array.from_numpy(none),
    )


def _numpy(table: Table, name: str) -> np.ndarray:
    if not table.num_rows:  # arro3 cannot join zero chunks
        kinds = {"track": np.int64, "frame": np.int64, "observed": bool, "class": np.int8}
        return np.zeros(0, kinds.get(name))
    return np.asarray(table[name].to_numpy())


def _lists(table: Table, name: str, nothing: float) -> np.ndarray:
    """Lists of one length as a matrix; rows of empty ones are ``nothing``."""
    if not table.num_rows:
        return np.zeros((0, 0))
    column = table[name].combine_chunks()
    lengths = np.diff(list_offsets(column).to_numpy())
    known = np.unique(lengths[lengths > 0])
    if len(known) > 1:
        raise InputError(
            f"the rows have skeletons of {' and '.join(str(k) for k in known)} keypoints; "
            "ask for one camera at a time"
        )
    k = int(known[0]) if len(known) else 0
    matrix = np.full((len(lengths), k), nothing)
    matrix[lengths > 0] = list_flatten(column).to_numpy().reshape(-1, k) if k else 0.0
    return matrix
