"""An event as small SVG pictures: from straight above, and its predicates over time."""

from collections.abc import Iterable
from html import escape

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.tracks import Tracks
from scene4d.drawing.ground import Area, grid_step, grid_values
from scene4d.searching._places import Places
from scene4d.searching.activities.course import Course
from scene4d.searching.result import FoundEvent

_ROLES = ("#E69F00", "#56B4E9", "#CC79A7", "#009E73")
"""Okabe and Ito (2008): told apart under every colour blindness, bright on dark footage."""
_SIDE_PX, _LEFT_PX, _BELOW_PX = 300.0, 34.0, 34.0
_LEAST_M = 6.0
"""The plan spans at least this much: two strides in a picture of centimetres would tell nothing."""
_STANDS_M = 0.4
"""Who moves less than this is drawn as a square: about the width of a person."""
_MOST_MARKS, _APART_PX = 4, 16.0
"""Marks of seconds along a path, so far apart that their texts can be read."""
_STEPS_S = (0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600)
_STYLE = (
    "max-width:24rem;width:100%;height:auto;font:12px system-ui,sans-serif;"
    "stroke-linecap:round;stroke-linejoin:round"
)
_COURSE_WIDTH, _COURSE_HEIGHT = 100.0, 24.0
_COURSE_STYLE = "grid-column:1/-1;width:100%;height:1.8rem;display:block"


def role_colours(roles: Iterable[str]) -> dict[str, str]:
    """One colour for each role in its order, in pictures and plans."""
    return {role: _ROLES[number % len(_ROLES)] for number, role in enumerate(roles)}


def plan_svg(found: FoundEvent, places: Places) -> str | None:
    """The plan; None where no role has a position, and nobody's zones are none.

    A role's path is a line in its colour, dotted before and after the event; dots count seconds
    since the event began, a square stands still. Others are grey, zones and lines dashed; a cross
    in a dashed circle is where another one was.
    """
    around, event = found.around, found.event
    if around is None:
        return None
    around = around.select(np.isfinite(around.xy_m).all(axis=1))
    during = _within(around, event.begin_s, event.end_s)
    playing = np.isin(around.track, list(event.roles.values()))
    zones = [] if event.roles else list(places.of(found.run.camera, "zone").values())
    shown = np.vstack([around.xy_m[during & playing], *zones])
    if not len(shown):
        return None
    drawn = _Drawing(_area(shown))
    for kind in ("zone", "line"):
        for name, points in places.of(found.run.camera, kind).items():
            drawn.place(name, np.vstack([points, points[:1]]) if kind == "zone" else points)
    for spot in found.spots:
        drawn.spot(spot.name, np.array(spot.xy_m), spot.tau_m)
    others = around.select(during & ~playing)
    for number in np.unique(others.track):
        drawn.path(others.xy_m[others.track == number], "#8a929c", 1.2)
    for role, colour in role_colours(event.roles).items():
        rows = around.select(around.track == event.roles[role])
        drawn.role(rows, event.begin_s, event.end_s, colour)
    named = ", ".join(f"{role} {number}" for role, number in event.roles.items())
    return drawn.svg(f"{event.activity} from above: {named}")


def _within(tracks: Tracks, begin_s: float, end_s: float) -> Bool[np.ndarray, "n"]:
    inside: np.ndarray = (tracks.time_s >= begin_s - 1e-6) & (tracks.time_s <= end_s + 1e-6)
    return inside


def _area(xy_m: Float[np.ndarray, "n 2"]) -> Area:
    """A square around the event, with a margin."""
    middle = (xy_m.min(axis=0) + xy_m.max(axis=0)) / 2
    half = max(_LEAST_M, 1.35 * float(np.ptp(xy_m, axis=0).max())) / 2
    (x0, y0), (x1, y1) = middle - half, middle + half
    return Area(float(x0), float(x1), float(y0), float(y1))


class _Drawing:
    """Elements in pixels of the plan, in which y points down; text has the page's colour."""

    def __init__(self, area: Area) -> None:
        self._area = area
        self._scale = _SIDE_PX / area.width
        self._inside: list[str] = []
        self._labels: list[str] = []
        self._grid()

    def _pixels(self, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        x = (xy_m[:, 0] - self._area.x_min) * self._scale
        y = (self._area.y_max - xy_m[:, 1]) * self._scale
        return np.column_stack([x, y])

    def _grid(self) -> None:
        area = self._area
        step = grid_step(area, lines=5)
        for x in grid_values(area.x_min, area.x_max, step):
            self._line(np.array([[x, area.y_min], [x, area.y_max]]))
            at = _LEFT_PX + (x - area.x_min) * self._scale
            self._labels.append(_text(at, _SIDE_PX + 14, f"{x + 0.0:g}", "middle"))
        for y in grid_values(area.y_min, area.y_max, step):
            self._line(np.array([[area.x_min, y], [area.x_max, y]]))
            at = (area.y_max - y) * self._scale + 4
            self._labels.append(_text(_LEFT_PX - 4, at, f"{y + 0.0:g}", "end"))
        middle = _LEFT_PX + _SIDE_PX / 2
        self._labels.append(_text(middle, _SIDE_PX + 28, "x, y in metres", "middle"))

    def _line(self, xy_m: Float[np.ndarray, "2 2"]) -> None:
        self.path(xy_m, "currentColor", 1.0, 'stroke-opacity=".12"')

    def path(
        self, xy_m: Float[np.ndarray, "n 2"], colour: str, width: float, more: str = ""
    ) -> None:
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in self._pixels(xy_m))
        self._inside.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
            f"{more}/>"
        )

    def place(self, name: str, points: Float[np.ndarray, "n 2"]) -> None:
        """A zone or a line with its name."""
        self.path(points, "currentColor", 1.2, 'stroke-dasharray="5 3"')
        (x, y), *_ = self._pixels(points[:1])
        self._inside.append(_text(x + 3, y - 3, name))

    def spot(self, name: str, middle: Float[np.ndarray, "2"], radius_m: float) -> None:
        """Where another one was, and how near to it is asked for."""
        ((x, y),) = self._pixels(middle[None])
        self._inside.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius_m * self._scale:.1f}" fill="none" '
            'stroke="currentColor" stroke-dasharray="2 3"/>'
            f'<path d="M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8" stroke="currentColor" '
            'stroke-width="2"/>'
        )
        self._inside.append(_text(x, y + 18, name, "middle"))

    def role(self, rows: Tracks, begin_s: float, end_s: float, colour: str) -> None:
        """The path of a role, with seconds since the event began."""
        self.path(rows.xy_m, colour, 1.4, 'stroke-dasharray="1 4"')
        now = rows.select(_within(rows, begin_s, end_s))
        if not len(now):
            return
        if np.ptp(now.xy_m, axis=0).max() <= _STANDS_M:
            (x, y), *_ = self._pixels(now.xy_m[-1:])
            self._inside.append(
                f'<rect x="{x - 5:.1f}" y="{y - 5:.1f}" width="10" height="10" fill="{colour}" '
                'stroke="currentColor"/>'
            )
            return
        self.path(now.xy_m, colour, 4.0)
        longest = end_s - begin_s
        step = next((s for s in _STEPS_S if longest <= _MOST_MARKS * s), longest / _MOST_MARKS)
        last = np.full(2, np.inf)
        for second in np.arange(0, longest + 1e-6, step):
            nearest = int(np.argmin(np.abs(now.time_s - begin_s - second)))
            ((x, y),) = at = self._pixels(now.xy_m[nearest : nearest + 1])
            if np.hypot(*(at[0] - last)) < _APART_PX:
                continue
            last = at[0]
            self._inside.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{colour}" stroke="currentColor"/>'
            )
            self._inside.append(_text(x + 6, y - 4, f"{second:g} s"))

    def svg(self, title: str) -> str:
        """The picture; what reaches beyond the frame is cut off."""
        width, height = _LEFT_PX + _SIDE_PX + 8, _SIDE_PX + _BELOW_PX
        frame = f'width="{_SIDE_PX:g}" height="{_SIDE_PX:g}"'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 -6 {width:g} {height + 6:g}" '
            f'role="img" style="{_STYLE}"><title>{escape(title)}</title>'
            f'<svg x="{_LEFT_PX:g}" {frame} overflow="hidden">{"".join(self._inside)}</svg>'
            f'<rect x="{_LEFT_PX:g}" {frame} fill="none" stroke="currentColor" '
            f'stroke-opacity=".4"/>'
            f"{''.join(self._labels)}</svg>"
        )


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="currentColor">'
        f"{escape(text)}</text>"
    )


# Predicates over time ---------------------------------------------------------------------------


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
        f'<svg class="course" viewBox="0 -1 {_COURSE_WIDTH:g} {_COURSE_HEIGHT + 2:g}" '
        f'style="{_COURSE_STYLE}" preserveAspectRatio="none" role="img" '
        f'aria-label="over time, 0 to 1, '
        f"{course.time_s[0] - found.event.begin_s:+.1f} to "
        f'{course.time_s[-1] - found.event.begin_s:+.1f} s from the beginning">'
        f'<rect x="{begin:.1f}" width="{max(end - begin, 0.5):.1f}" height="{_COURSE_HEIGHT:g}" '
        f'fill="currentColor" fill-opacity=".09"/>{lines}</svg>'
    )


def _at(course: Course, time_s: float | np.ndarray) -> np.ndarray:
    first, last = course.time_s[0], course.time_s[-1]
    return np.asarray(_COURSE_WIDTH * np.clip((time_s - first) / (last - first), 0, 1))


def _parts(course: Course, name: str) -> list[str]:
    """The curve as points, in pieces where the predicate cannot be judged."""
    values = course.values[name]
    x, y = _at(course, course.time_s), _COURSE_HEIGHT * (1 - values)
    gone = np.flatnonzero(np.isnan(values))
    pieces = np.split(np.column_stack([x, y]), gone)
    held = (piece[np.isfinite(piece[:, 1])] for piece in pieces)
    return [" ".join(f"{a:.1f},{b:.1f}" for a, b in piece) for piece in held if len(piece) > 1]
