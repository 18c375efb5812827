"""KPF (KWIVER packet format) activities, as MEVA has them: ``NAME.activities.yml``.

One packet per line, in the flow style of YAML: ``act2`` names with their probabilities, ``id2`` the
number of the activity, ``timespan`` its first and last frame as ``tsr0``, ``actors`` the tracks
(``id1``) with time spans of their own.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import in_file, quoted, read_text
from scene4d.core.yaml_text import load_yaml
from scene4d.formats._numbers import lines_of

_LARGEST = 2.0**53  # beyond it, not every whole number is a float


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
                found.append(_activity(packet, where))
    return tuple(found)


def _packet(line: str, where: str) -> dict[str, Any]:
    try:
        packets = load_yaml(line)
    except InputError:
        packets = None
    if not (isinstance(packets, list) and len(packets) == 1 and isinstance(packets[0], dict)):
        raise InputError(f"{where}: expected one KPF packet, found {quoted(line.strip())}")
    return packets[0]


def _activity(packet: dict[str, Any], where: str) -> LabelledActivity:
    act = JsonObject(packet, where).object("act")
    names = act.value("act2")
    if not (isinstance(names, dict) and names and all(isinstance(name, str) for name in names)):
        raise act.error("act2", "names with probabilities")
    score = {name: act.object("act2").number(name) for name in names}
    spans = np.array([span.array("tsr0", 2) for span in act.objects("timespan")]).reshape(-1, 2)
    whole = (spans % 1 == 0) & (spans >= 0) & (spans < _LARGEST)
    if not (len(spans) and whole.all() and (spans[:, 0] <= spans[:, 1]).all()):
        raise act.error("timespan", "'tsr0': [first frame, last frame]")
    actors = act.objects("actors") if "actors" in act else []
    return LabelledActivity(
        max(score, key=score.__getitem__),
        int(spans.min()),
        int(spans.max()),
        tuple(one.integer("id1", least=0) for one in actors),
    )
