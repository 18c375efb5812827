"""What a detector saw, chunk by chunk on disk, so that a killed run goes on where it stopped.

    settings.json     what the detections are of, and what made them
    00000.npz         detections (and appearance) of the first chunk of frames, and so on
    finished.json     how many chunks there are, once there are no more

Detection takes hours where everything after it takes minutes: it is what a rerun must not repeat.
"""

import io
import itertools
import json
import os
import re
import zipfile
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
_APPEARANCE, _FRAMES, _TIMES = "appearance", "frames_seen", "times_seen"
_ABSENT = "nothing"


@dataclass(frozen=True, eq=False)
class Look:
    """What was seen in some successive frames (m,), all of those that were looked at, with their
    times; ``detections`` are ordered by frame. ``appearance`` is what each of them looks like, None
    where nobody knows.

    Raises :class:`InputError` where the parts do not belong together.
    """

    frame: Int[np.ndarray, "m"]
    time_s: Float[np.ndarray, "m"]
    detections: Detections
    appearance: Float[np.ndarray, "n d"] | Float32[np.ndarray, "n d"] | None = None

    def __post_init__(self) -> None:
        if self.appearance is not None and len(self.appearance) != len(self.detections):
            raise InputError(
                f"appearance: has {len(self.appearance)} rows, expected one for each of the "
                f"{len(self.detections)} detections"
            )
        if len(self.time_s) != len(self.frame):
            raise InputError(f"frames: {len(self.frame)} have {len(self.time_s)} times")
        if not np.isin(self.detections.frame, self.frame).all():
            raise InputError("detections: some are of a frame that was not looked at")

    def frames(self) -> Iterator[tuple[int, float, Int[np.ndarray, "k"]]]:
        """Number and time of each frame, and which rows are of it."""
        begins = np.searchsorted(self.detections.frame, self.frame)
        ends = np.searchsorted(self.detections.frame, self.frame, side="right")
        for frame, time_s, begin, end in zip(self.frame, self.time_s, begins, ends, strict=True):
            yield int(frame), float(time_s), np.arange(begin, end)


class DetectionLog:
    """The detections of one source under one set of settings, in a folder of their own.

    ``settings`` is all that they depend on (source and its size and date, frames per chunk,
    detector, hashes of weights, software version), as JSON can hold it. Raises
    :class:`InputError` where the folder holds detections under other settings, naming what
    differs, and :class:`OutputError` where it cannot be written to.
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
        """How many chunks are there from the first one on without a hole: the next to be seen."""
        return self._complete

    @property
    def finished(self) -> bool:
        """Whether there are no more chunks to come."""
        return self._finished_path.exists()

    def append(self, look: Look) -> None:
        """Write the next chunk, atomically.

        Raises :class:`InputError` where the log is finished, and :class:`OutputError` where the
        file cannot be written.
        """
        if self.finished:
            raise InputError(f"{self._folder}: is finished, nothing can be added")
        detections = look.detections
        columns: dict[str, Any] = {
            f.name: np.asarray(getattr(detections, f.name)) for f in fields(Detections)
        }
        columns["class_name"] = detections.class_name.astype(str)  # objects would be pickled
        columns |= {_FRAMES: look.frame, _TIMES: look.time_s}
        if look.appearance is not None:
            columns[_APPEARANCE] = look.appearance
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
        """Say that there are no more chunks to come."""
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
    """Refuse a log of another version, and other settings where anything was detected by them."""
    stored = read_json(path)
    schema = stored.get("schema") if isinstance(stored, dict) else None
    if schema != _LOG_SCHEMA:
        raise InputError(f"{path}: schema is {quoted(schema)}, expected {_LOG_SCHEMA!r}")
    if not binding:
        return
    before, now = dict(_leaves(stored.get("settings"))), dict(_leaves(settings))
    differing = [
        f"{name} ({_shown(before, name)} there, {_shown(now, name)} now)"
        for name in sorted({*before, *now})
        if _shown(before, name) != _shown(now, name)
    ]
    if differing:
        raise InputError(
            f"{path.parent}: holds detections under other settings: {', '.join(differing)}; remove "
            "the folder to detect again, or choose another"
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


def _read_chunk(path: Path) -> Look:
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            columns = {name: file[name] for name in file.files}
        frame, time_s = columns.pop(_FRAMES), columns.pop(_TIMES)
        appearance = columns.pop(_APPEARANCE, None)
        for name in ("image_size", "keypoint_names"):
            columns[name] = tuple(columns[name].tolist())
        return Look(frame, time_s, Detections(**columns), appearance)
    except (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: is damaged: {error}; remove it, and it is detected again"
        ) from error
