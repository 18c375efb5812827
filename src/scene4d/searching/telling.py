"""What was found, in words."""

from pathlib import PurePath

from scene4d.searching.clock import moment
from scene4d.searching.finding import FoundEvent, Search
from scene4d.store.runs import Run

_KPF = (".geom.yml", ".types.yml")


def clip_name(run: Run) -> str:
    """The file that a run was made of, without folders; of annotations without their ending."""
    source = run.provenance.get("source") or run.provenance.get("annotations")
    if not isinstance(source, str) or "://" in source:
        return run.run
    name = PurePath(source).name
    ending = next((end for end in _KPF if name.endswith(end)), "")
    return name.removesuffix(ending)


def when(found: FoundEvent, *, until: bool = True) -> str:
    """The clock's time (UTC) where it is known, and the clip's."""
    begin, end = found.event.begin_s, found.event.end_s
    clip = f"{clip_time(begin)} to {clip_time(end)}" if until else clip_time(begin)
    began = moment(found.run, begin)
    return clip if began is None else f"{began:%Y-%m-%d %H:%M:%S} UTC, clip {clip}"


def clip_time(seconds: float) -> str:
    """``01:02:03.4``, the hours where there are any."""
    tenths = round(10 * seconds)
    minutes, tenths = divmod(tenths, 600)
    hours, minutes = divmod(minutes, 60)
    text = f"{minutes:02d}:{tenths // 10:02d}.{tenths % 10}"
    return f"{hours}:{text}" if hours else text


def verdict(done: Search) -> str:
    """One sentence on what was found, and of nothing how much was looked at."""
    clips = _count(len(done.runs), "clip")
    cameras = _count(len({run.camera for run in done.runs}), "camera")
    where = f"{clips} of {cameras}"
    if done.events:
        return f"{_count(len(done.events), 'event')} in {where}."
    roles = [role.name for role in done.asked.query.activity.roles]
    what = {1: "track", 2: "pair"}.get(len(roles), "group")
    return (
        f"Nothing found in {where}: of {_count(done.candidates, f'candidate {what}')} "
        f"({', '.join(roles)}) none scores {done.least_score:g} or more."
    )


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
