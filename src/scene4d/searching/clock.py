"""When something was: seconds of a clip as moments, and times of day."""

from datetime import UTC, datetime, timedelta

from scene4d.searching.language import Window
from scene4d.store.query import Scene
from scene4d.store.runs import Run

_DAY_S = 86_400.0
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def moment(run: Run, time_s: float) -> datetime | None:
    """The moment (UTC) of a time in a run; None where its start is not known."""
    if not run.start_known:
        return None
    return _EPOCH + timedelta(microseconds=round(run.moment_ns(time_s) / 1000))


def second_of_day(run: Run, time_s: float) -> float:
    """Seconds from midnight, UTC; counted from the clip's start where that is not known."""
    return (run.moment_ns(time_s) / 1e9) % _DAY_S


def reaches(run: Run, window: Window | None) -> bool:
    """Whether anything in a run can begin in the window."""
    if window is None:
        return True
    if not run.start_known or not run.parts:
        return False
    begin_s = min(part.begin_s for part in run.parts)
    length_s = max(part.end_s for part in run.parts) - begin_s
    first = second_of_day(run, begin_s)
    return window.contains(first) or (window.begin_s - first) % _DAY_S <= length_s


def unknown_starts(scene: Scene) -> tuple[str, ...]:
    """Runs with rows of which nobody knows when they began."""
    return tuple(run.run for run in scene.runs if run.rows and not run.start_known)
