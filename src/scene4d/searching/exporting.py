"""Events of searches as text for other programs: JSON, CSV, and what NIST's ActEV_Scorer reads."""

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Sequence

from scene4d.core.envelope import envelope
from scene4d.core.errors import InputError
from scene4d.core.text import nearest, quoted
from scene4d.formats.activities import ActevInstance, actev_json
from scene4d.searching._asking import reaches
from scene4d.searching.result import SearchResult, clip_name
from scene4d.store.runs import Run

_REFUSED_BY_SCORER = re.compile(r"[^A-Za-z0-9_\-.]")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet would take for a formula is given a quote in front."""


def exported(results: Sequence[SearchResult], form: str) -> str:
    """All events of searches of one scene in a form of :data:`EXPORTS`.

    Raises :class:`InputError` for another form.
    """
    if form not in EXPORTS:
        raise InputError(f"format: found {quoted(form)}{nearest(form, EXPORTS)}")
    return EXPORTS[form](results)


def _json(results: Sequence[SearchResult]) -> str:
    """What ``--json`` prints of the searches: every event, and what they were understood as."""
    notes = [note for one in results for note in one.asked.notes]
    found = [one.to_dict() for one in results]
    fields = found[0] if len(found) == 1 else {"searches": found}
    return _text(envelope("search", fields, warnings=notes))


def _csv(results: Sequence[SearchResult]) -> str:
    """The table of each search below that of the one before, with the roles of all."""
    tables = [{name: values for name, (_, values) in one.columns().items()} for one in results]
    names = list(dict.fromkeys(name for table in tables for name in table if name != "why"))
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow([*map(_cell, names), "why"])
    for table in tables:
        blank = [None] * len(table["why"])
        columns = [table.get(name, blank) for name in [*names, "why"]]
        writer.writerows([map(_cell, row) for row in zip(*columns, strict=True)])
    return out.getvalue()


def _cell(value: object) -> object:
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def _actev(results: Sequence[SearchResult]) -> str:
    """Under the names that MEVA gives activities, where it gives one; files as the footage."""
    windows = [one.asked.query.window for one in results]
    runs = [run for one in results[:1] for run in one.asked.scene.runs]
    names = actev_files([run for run in runs if any(reaches(run, window) for window in windows)])
    instances = [
        ActevInstance(
            next(
                iter(one.asked.query.activity.option(found.event.activity).labels),
                found.event.activity,
            ),
            names[found.run.run],
            found.begin_frame,
            found.end_frame,
            found.event.score,
        )
        for one in results
        for found in one.events
    ]
    return _text(actev_json(instances, list(names.values())))


def actev_files(runs: list[Run]) -> dict[str, str]:
    """A name for each run's footage that the scorer accepts: characters that it refuses become
    ``_``, and runs that would share a name are named after the run instead.
    """
    names = {run.run: _REFUSED_BY_SCORER.sub("_", clip_name(run)) for run in runs}
    count = Counter(names.values())
    return {
        run: _REFUSED_BY_SCORER.sub("_", run) if count[name] > 1 else name
        for run, name in names.items()
    }


def _text(values: dict[str, object]) -> str:
    return json.dumps(values, indent=1, allow_nan=False) + "\n"


EXPORTS: dict[str, Callable[[Sequence[SearchResult]], str]] = {
    "json": _json,
    "csv": _csv,
    "actev": _actev,
}
"""Forms by name."""
