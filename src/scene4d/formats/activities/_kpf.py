"""KPF (KWIVER packet format) activities, as MEVA has them: ``NAME.activities.yml``.

One packet per line, in the flow style of YAML: ``act2`` names with their probabilities, ``id2`` the
number of the activity, ``timespan`` its first and last frame as ``tsr0``, ``actors`` the tracks
(``id1``) with time spans of their own.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scene4d.core.errors import InputError
from scene4d.core.text import in_file, quoted, read_text
from scene4d.core.yaml_text import load_yaml
from scene4d.formats._numbers import lines_of


@dataclass(frozen=True)
class LabelledActivity:
    """What somebody says happened: frames count from 0, and ``actors`` are numbers of tracks."""

    name: str
    begin_frame: int
    end_frame: int
    actors: tuple[int, ...]


def read_activities(path: str | os.PathLike[str]) -> tuple[LabelledActivity, ...]:
    """The activities of a file, in its order; none where it says only that nothing happened.

    Of several names the most probable one counts, of several time spans the first and the last
    frame. Raises :class:`InputError` naming file, line and field.
    """
    path = Path(path)
    found = []
    with in_file(path):
        for where, line in lines_of(read_text(path), ("#", "---")):
            packet = _packet(line, where)
            if "act" in packet:
                found.append(_activity(packet["act"], where))
    return tuple(found)


def _packet(line: str, where: str) -> dict[str, Any]:
    try:
        packets = load_yaml(line)
    except InputError:
        packets = None
    if not (isinstance(packets, list) and len(packets) == 1 and isinstance(packets[0], dict)):
        raise InputError(f"{where}: expected one KPF packet, found {quoted(line.strip())}")
    return packets[0]


def _activity(act: Any, where: str) -> LabelledActivity:
    if not isinstance(act, dict):
        raise InputError(f"{where}: field 'act' must hold an activity, found {quoted(act)}")
    actors = act.get("actors", [])
    if not isinstance(actors, list):
        raise InputError(f"{where}: field 'actors' must be a list, found {quoted(actors)}")
    begin, end = _frames(act.get("timespan"), where)
    return LabelledActivity(
        _name(act.get("act2"), where), begin, end, tuple(_track(one, where) for one in actors)
    )


def _name(names: Any, where: str) -> str:
    if not (
        isinstance(names, dict)
        and names
        and all(isinstance(k, str) and _is_number(v) for k, v in names.items())
    ):
        raise InputError(
            f"{where}: field 'act2' must hold names with probabilities, found {quoted(names)}"
        )
    return str(max(names, key=lambda name: names[name]))


def _frames(spans: Any, where: str) -> tuple[int, int]:
    try:
        pairs = [span["tsr0"] for span in spans]
        frames = [frame for pair in pairs for frame in pair]
        good = bool(pairs) and all(len(pair) == 2 and pair[0] <= pair[1] for pair in pairs)
    except (TypeError, KeyError):
        good, frames = False, []
    if not good or not all(type(frame) is int and frame >= 0 for frame in frames):
        raise InputError(
            f"{where}: field 'timespan' must hold 'tsr0': [first frame, last frame], "
            f"found {quoted(spans)}"
        )
    return min(frames), max(frames)


def _track(actor: Any, where: str) -> int:
    track = actor.get("id1") if isinstance(actor, dict) else None
    if type(track) is not int or track < 0:
        raise InputError(f"{where}: field 'id1' of an actor must be a track, found {quoted(actor)}")
    return track


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
