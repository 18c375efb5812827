"""Where the time of one search goes: python -m benchmarks.search_stages SCENE WORDS FILE

Runs the command in this process, with stopwatches around its stages, and writes the seconds of each
into FILE as JSON. A stage inside another one is taken out of that. Nothing is imported before the
clock runs.
"""

import time

BEGUN = time.perf_counter()

import contextlib  # noqa: E402
import importlib  # noqa: E402
import io  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
from collections import Counter  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

IMPORTS = "start, import"
STAGES = (
    ("scene4d.searching", "understand", "understand the words"),
    ("scene4d.searching._entry", "lean_tracks", "read"),
    ("scene4d.searching._entry", "staged_run", "read"),
    ("scene4d.searching.activities.search", "cast", "cast"),
    ("scene4d.searching.activities.search", "gather", "judge"),
    ("scene4d.searching.activities.search", "_align", "align"),
    ("scene4d.searching.activities.search", "found_event", "one event per occurrence"),
    ("scene4d.searching.activities.search", "one_per_occurrence", "one event per occurrence"),
    ("scene4d.cli.search", "_show_understood", "print"),
    ("scene4d.cli.search", "_show", "print"),
)
"""Module, function, and what it is called here."""
ALSO = (
    "duckdb",
    "scene4d.store.query",
    "scene4d.searching.language",
    "scene4d.cli.app",
    "scene4d.cli.output",
    "scene4d.cli.progress",
    "rich.console",
)
"""What the command imports on its way."""


class Stopwatch:
    """Seconds by stage; of stages within one another only the innermost counts."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._inner: list[float] = []

    def around(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        def run(*positional: Any, **named: Any) -> Any:
            begun = time.perf_counter()
            self._inner.append(0.0)
            try:
                return function(*positional, **named)
            finally:
                taken = time.perf_counter() - begun
                self.seconds[stage] += taken - self._inner.pop()
                if self._inner:
                    self._inner[-1] += taken

        return run


def main() -> None:
    scene, words, file = sys.argv[1:]
    modules = {name: importlib.import_module(name) for name, _, _ in STAGES}
    for name in ALSO:
        importlib.import_module(name)
    watch = Stopwatch()
    watch.seconds[IMPORTS] = time.perf_counter() - BEGUN
    for name, function, stage in STAGES:
        setattr(modules[name], function, watch.around(getattr(modules[name], function), stage))
    sys.argv = ["scene4d", "search", scene, words]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        importlib.import_module("scene4d.cli").main()
    order = dict.fromkeys([IMPORTS, *(stage for _, _, stage in STAGES)])
    Path(file).write_text(json.dumps({stage: watch.seconds[stage] for stage in order}))


if __name__ == "__main__":
    main()
