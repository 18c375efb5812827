"""Predicates of an event over time, as small plots for its card."""

import numpy as np

from scene4d.searching.activities.course import Course
from scene4d.searching.result import FoundEvent

_WIDTH, _HEIGHT = 100.0, 24.0
_STYLE = "grid-column:1/-1;width:100%;height:1.8rem;display:block"


def course_svg(found: FoundEvent, name: str) -> str:
    """One predicate as a curve from 0 to 1, the event's span shaded; empty where there is none."""
    course = found.course
    if course is None or name not in course.values or len(course.time_s) < 2:
        return ""
    begin, end = (_at(course, time_s) for time_s in (found.event.begin_s, found.event.end_s))
    lines = "".join(
        f'<polyline points="{part}" fill="none" stroke="#2f7dc4" stroke-width="1.6" '
        'vector-effect="non-scaling-stroke"/>'
        for part in _parts(course, name)
    )
    return (
        f'<svg class="course" viewBox="0 -1 {_WIDTH:g} {_HEIGHT + 2:g}" style="{_STYLE}" '
        f'preserveAspectRatio="none" role="img" aria-label="over time, 0 to 1, '
        f"{course.time_s[0] - found.event.begin_s:+.1f} to "
        f'{course.time_s[-1] - found.event.begin_s:+.1f} s from the beginning">'
        f'<rect x="{begin:.1f}" width="{max(end - begin, 0.5):.1f}" height="{_HEIGHT:g}" '
        f'fill="currentColor" fill-opacity=".09"/>{lines}</svg>'
    )


def _at(course: Course, time_s: float | np.ndarray) -> np.ndarray:
    first, last = course.time_s[0], course.time_s[-1]
    return np.asarray(_WIDTH * np.clip((time_s - first) / (last - first), 0, 1))


def _parts(course: Course, name: str) -> list[str]:
    """The curve as points, in pieces where the predicate cannot be judged."""
    values = course.values[name]
    x, y = _at(course, course.time_s), _HEIGHT * (1 - values)
    gone = np.flatnonzero(np.isnan(values))
    pieces = np.split(np.column_stack([x, y]), gone)
    held = (piece[np.isfinite(piece[:, 1])] for piece in pieces)
    return [" ".join(f"{a:.1f},{b:.1f}" for a, b in piece) for piece in held if len(piece) > 1]
