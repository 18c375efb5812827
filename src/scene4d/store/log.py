"""Detections on disk, chunk by chunk, so that a killed run resumes where it stopped.

    settings.json     the source of the detections, and the settings that produced them
    00000.npz         detections (and appearance and colours) of the first chunk, and so on
    finished.json     the number of chunks, once all are written

Detection takes hours and everything after it minutes, so a rerun must not repeat it.
"""

import io
import itertools
import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from scene4d.core.errors import InputError, OutputError
from scene4d.core.files import read_json, write_bytes, write_json
from scene4d.core.people import Detections
from scene4d.core.text import quoted

_LOG_SCHEMA = "scene4d/detections/1"
_CHUNK = re.compile(r"(\d{5,})\.npz")
_APPEARANCE, _COLOURS = "appearance", "colours"
_FRAMES, _TIMES = "frames_seen", "times_seen"
_ABSENT = "nothing"


@dataclass(frozen=True, eq=False)
class Look:
    """The detections in successive analysed frames (m,), with their times.

    All analysed frames are listed, also those without a detection; ``detections`` are ordered by
    frame. ``appearance`` (histograms) and ``colours`` (readings of upper and lower parts, see
    :class:`.ColourReader`) hold one row per detection, None if unknown. Raises :class:`InputError`
    if the parts are inconsistent.
    """

    frame: Int[np.ndarray, "m"]
    time_s: Float[np.ndarray, "m"]
    detections: Detections
    appearance: Float[np.ndarray, "n d"] | Float32[np.ndarray, "n d"] | None = None
    colours: Float32[np.ndarray, "n 8"] | None = None

    def __post_init__(self) -> None:
        for name in (_APPEARANCE, _COLOURS):
            rows = getattr(self, name)
            if rows is not None and len(rows) != len(self.detections):
                raise InputError(
                    f"{name}: has {len(rows)} rows, expected one for each of the "
                    f"{len(self.detections)} detections"
                )
        if len(self.time_s) != len(self.frame):
            raise InputError(f"frames: {len(self.frame)} have {len(self.time_s)} times")
        if not np.isin(self.detections.frame, self.frame).all():
            raise InputError("detections: some are of a frame that was not looked at")

    def frames(self) -> Iterator[tuple[int, float, Int[np.ndarray, "k"]]]:
        """Number, time and rows of each frame."""
        begins = np.searchsorted(self.detections.frame, self.frame)
        ends = np.searchsorted(self.detections.frame, self.frame, side="right")
        for frame, time_s, begin, end in zip(self.frame, self.time_s, begins, ends, strict=True):
            yield int(frame), float(time_s), np.arange(begin, end)


class DetectionLog:
    """The detections of one source with one set of settings, in their own folder.

    ``settings`` is everything they depend on (source with size and date, frames per chunk,
    detector, hashes of weights, software version), as JSON values. Raises :class:`InputError` if
    the folder holds detections with other settings, naming the differences, and
    :class:`OutputError` if it is not writable.
    """

    def __init__(self, folder: str | os.PathLike[str], settings: dict[str, Any]) -> None:
        self._folder = Path(folder)
        try:
            settings = json.loads(json.dumps(settings, allow_nan=False))
        except (TypeError, ValueError) as error:
            raise InputError(f"settings: cannot be written as JSON: {error}") from error
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            names = [path.name for path in self._folder.iterdir()]
        except OSError as error:
            raise OutputError(f"{self._folder}: cannot be written to: {error.strerror}") from error
        path = self._folder / "settings.json"
        there = {int(match[1]) for match in map(_CHUNK.fullmatch, names) if match}
        if path.name in names:
            _check_settings(path, settings, binding=bool(there))
        if not there:
            write_json(path, {"schema": _LOG_SCHEMA, "settings": settings})
        self._complete = next(chunk for chunk in itertools.count() if chunk not in there)
        self._check_finished()

    @property
    def complete(self) -> int:
        """Number of consecutive chunks from the first one on; the number of the next chunk."""
        return self._complete

    @property
    def finished(self) -> bool:
        """Whether all chunks are written."""
        return self._finished_path.exists()

    def append(self, look: Look) -> None:
        """Write the next chunk, atomically.

        Raises :class:`InputError` if the log is finished, and :class:`OutputError` if the file
        cannot be written.
        """
        if self.finished:
            raise InputError(f"{self._folder}: is finished, nothing can be added")
        detections = look.detections
        columns: dict[str, Any] = {
            f.name: np.asarray(getattr(detections, f.name)) for f in fields(Detections)
        }
        columns["class_name"] = detections.class_name.astype(str)  # objects would be pickled
        columns |= {_FRAMES: look.frame, _TIMES: look.time_s}
        more = {_APPEARANCE: look.appearance, _COLOURS: look.colours}
        columns |= {name: rows for name, rows in more.items() if rows is not None}
        content = io.BytesIO()
        np.savez(content, **columns)
        write_bytes(self._path(self._complete), content.getvalue())
        self._complete += 1

    def chunks(self) -> Iterator[Look]:
        """The complete chunks in order, one in memory at a time.

        Raises :class:`InputError` for a damaged file, naming it.
        """
        return (_read_chunk(self._path(chunk)) for chunk in range(self._complete))

    def finish(self) -> None:
        """Mark the log as complete."""
        write_json(self._finished_path, {"chunks": self._complete})

    @property
    def _finished_path(self) -> Path:
        return self._folder / "finished.json"

    def _path(self, chunk: int) -> Path:
        return self._folder / f"{chunk:05d}.npz"

    def _check_finished(self) -> None:
        if self.finished:
            said = read_json(self._finished_path)
            chunks = said.get("chunks") if isinstance(said, dict) else None
            if chunks != self._complete:
                raise InputError(
                    f"{self._finished_path}: says {quoted(chunks)} chunks, found {self._complete}; "
                    "remove it, and the missing ones are detected again"
                )


def _check_settings(path: Path, settings: dict[str, Any], *, binding: bool) -> None:
    """Reject a log of another version, or of other settings if it holds detections."""
    stored = read_json(path)
    schema = stored.get("schema") if isinstance(stored, dict) else None
    if schema != _LOG_SCHEMA:
        raise InputError(f"{path}: schema is {quoted(schema)}, expected {_LOG_SCHEMA!r}")
    if not binding:
        return
    before, now = dict(_leaves(stored.get("settings"))), dict(_leaves(settings))
    differing = [
        f"{_short(name)} ({_short(_shown(before, name))} there, {_short(_shown(now, name))} now)"
        for name in sorted({*before, *now})
        if _shown(before, name) != _shown(now, name)
    ]
    if differing:
        more = f" and {len(differing) - 5} more" if len(differing) > 5 else ""
        raise InputError(
            f"{path.parent}: holds detections under other settings: {', '.join(differing[:5])}"
            f"{more}; remove the folder to detect again, or choose another"
        )


def _leaves(values: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings under dotted names."""
    if isinstance(values, dict) and values:
        for key, value in values.items():
            yield from _leaves(value, f"{name}.{key}" if name else key)
    else:
        yield name, values


def _shown(leaves: dict[str, Any], name: str) -> str:
    return json.dumps(leaves[name]) if name in leaves else _ABSENT


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


def _read_chunk(path: Path) -> Look:
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            columns = {name: file[name] for name in file.files}
        frame, time_s = columns.pop(_FRAMES), columns.pop(_TIMES)
        appearance, colours = columns.pop(_APPEARANCE, None), columns.pop(_COLOURS, None)
        for name in ("image_size", "keypoint_names"):
            columns[name] = tuple(columns[name].tolist())
        return Look(frame, time_s, Detections(**columns), appearance, colours)
    except Exception as error:  # whatever zipfile and numpy make of damaged bytes
        raise InputError(
            f"{path}: is damaged: {quoted(str(error))}; remove it, and it is detected again"
        ) from error
