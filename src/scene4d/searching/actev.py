"""A search as NIST's ActEV_Scorer reads it."""

import re
from collections.abc import Sequence
from pathlib import Path

from scene4d.core.files import write_json
from scene4d.formats.activities import ActevInstance, actev_json
from scene4d.searching.finding import Search
from scene4d.searching.telling import clip_name
from scene4d.store.runs import Run

_REFUSED = re.compile(r"[^A-Za-z0-9_\-.]")


def write_actev(done: Search, path: Path) -> None:
    """Every event as NIST's ActEV_Scorer reads it; files are named as the clips' footage.

    An activity has the name that MEVA gives it where it gives it one. Raises :class:`OutputError`.
    """
    names = actev_files(done.runs)
    labels = done.asked.query.activity.labels
    instances = [
        ActevInstance(
            labels[0] if labels else one.event.activity,
            names[one.run.run],
            one.begin_frame,
            one.end_frame,
            one.event.score,
        )
        for one in done.events
    ]
    write_json(path, actev_json(instances, [names[run.run] for run in done.runs]))


def actev_files(runs: Sequence[Run]) -> dict[str, str]:
    """A name for each run's footage that the scorer takes: characters that it refuses become
    ``_``, and where two would have one name, they have those of their runs, which differ.
    """
    names = {run.run: _REFUSED.sub("_", clip_name(run)) for run in runs}
    taken = list(names.values())
    return {
        run: _REFUSED.sub("_", run) if taken.count(name) > 1 else name
        for run, name in names.items()
    }
