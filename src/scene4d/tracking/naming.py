"""What a run is called: the same footage gets the same name, other footage another."""

import hashlib
from datetime import datetime
from pathlib import Path

from scene4d.video.stream import stream_name, without_password


def shown_name(seen: str | Path) -> str:
    """A file's name without folders and ending; a stream's host and path, without passwords."""
    return stream_name(str(seen)) if "://" in str(seen) else Path(seen).stem


def run_name(seen: str | Path, start: datetime | None) -> str:
    """The footage's name, with a mark that tells it from others of that name; of a stream, which
    is never the same again, with the moment when it began.
    """
    text = without_password(str(seen))
    is_stream = "://" in text
    place = text if is_stream else str(Path(text).resolve())
    name = f"{shown_name(seen)}-{hashlib.sha256(place.encode()).hexdigest()[:6]}"
    return f"{name}-{start:%Y%m%dT%H%M%SZ}" if is_stream and start is not None else name
