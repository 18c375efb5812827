"""What a writer puts into a manifest, and its way to the disk."""

import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.errors import InputError, OutputError
from scene4d.core.tracks import Tracks
from scene4d.store.runs import since_1970_ns

_YEARS = (1900, 2200)  # what nanoseconds in 64 bits can hold, with room for the footage


def classes(buffer: Sequence[Tracks]) -> Counter[str]:
    """Numbers of rows by class."""
    total: Counter[str] = Counter()
    for tracks in buffer:
        names, counts = np.unique(tracks.class_name, return_counts=True)
        total.update(dict(zip(names.tolist(), counts.tolist(), strict=True)))
    return total


def start_ns(start_utc: datetime | None) -> int:
    """Nanoseconds since 1970; 0 if unknown. Raises :class:`InputError` without a time zone."""
    if start_utc is None:
        return 0
    if start_utc.tzinfo is None:
        raise InputError(f"start_utc: {start_utc.isoformat()} has no time zone, expected UTC")
    first, last = _YEARS
    if not first <= start_utc.year < last:
        raise InputError(f"start_utc: year {start_utc.year}, expected {first} to {last - 1}")
    return since_1970_ns(start_utc)


def as_json(values: dict[str, Any], what: str) -> dict[str, Any]:
    """The values as they will be read back; fails now and not after hours of work."""
    try:
        return json.loads(json.dumps(values, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: cannot be written as JSON: {error}") from error


def settle(folder: Path) -> None:
    """Names in a folder reach the disk before the manifest that relies on them."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:  # Windows opens no folder; NTFS logs names in their order
        return
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Failures of the system become an :class:`OutputError` that names the scene."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written to: {error}") from error
