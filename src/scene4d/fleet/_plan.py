"""The plan of a fleet: which cameras, where their footage is, and what to do with it.

    cameras:
      gate:
        footage: gate/*.mp4            # a file, a glob, or a list of them
        camera: gate/camera.json       # else calibrated from its first clip
        start: "gate-%Y%m%dT%H%M%S"    # when a clip begins, read from its name; UTC
      yard: {boxes: yard/*.txt, camera: yard.json}     # annotations in place of footage
    calibrate: {person_height_m: 1.75}                 # as CalibrateOptions, and so on
    track: {rate_hz: 5}
    align: {}
    search: {words: ["person enters vehicle"]}
    workers: {cores: 1, memory_gb: 2, attempts: 3}
    every_s: 600                                       # and again ten minutes after it began

What stands there is done. A folder in place of the file is a camera for each folder with videos in
it, calibrated from its first clip or known from a ``camera.json`` there, and tracked.
"""

import glob
import types
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import in_file, quoted, read_text
from scene4d.core.yaml_text import load_yaml
from scene4d.store.runs import file_name
from scene4d.video.frames import VIDEO_SUFFIXES

if TYPE_CHECKING:  # a worker loads those of its own task alone
    from scene4d.alignment import AlignOptions
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.searching import SearchOptions
    from scene4d.tracking import TrackOptions

_STAGES = ("calibrate", "track", "align", "search")
_CAMERA = "camera.json"
_OWN = frozenset({"annotations", "name", "start", "footage", "top", "landmarks"})
"""Options that differ from clip to clip, or that a plan says elsewhere."""
_MOST_S = 366 * 86_400.0
_STILL_S = 60.0
"""A clip that has not changed for so long is whole. Recorders write every few seconds; a share over
NFS tells the time of change up to a minute late (``acregmax``).
"""

T = TypeVar("T")


@dataclass(frozen=True)
class Footage:
    """A camera's clips, in order of their names; ``boxes``: they are annotations. ``camera`` is its
    calibration, None where that is to be found, and ``start`` the pattern of clips' names.
    ``recording`` clips more are left for the next round.
    """

    name: str
    clips: tuple[Path, ...]
    boxes: bool = False
    camera: Path | None = None
    start: str | None = None
    recording: int = 0

    def begins(self, clip: Path) -> datetime | None:
        """When a clip begins; raises :class:`InputError` for a name that does not say it."""
        if self.start is None:
            return None
        try:
            found = datetime.strptime(clip.stem, self.start)
        except ValueError:
            raise InputError(
                f"{clip}: field 'cameras.{self.name}.start': the name does not say when the clip "
                f"begins as {quoted(self.start)} does; rename it, or mend the pattern"
            ) from None
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).astimezone(UTC)


@dataclass(frozen=True)
class Workers:
    """What one task takes, and after how many killed workers a clip is put aside."""

    cores: float = 1.0
    memory_gb: float = 2.0
    attempts: int = 3

    def __post_init__(self) -> None:
        """Check the ranges; raises :class:`InputError`."""
        ranges = {"cores": (0.01, 1024), "memory_gb": (0.01, 4096), "attempts": (1, 1000)}
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                found = getattr(self, name)
                raise InputError(f"{name}: found {found:g}, expected {least} to {most}")


@dataclass(frozen=True)
class Plan:
    """A plan that was read and checked; a stage that is None is not wanted. It is done once, or
    every ``every_s`` seconds.
    """

    cameras: tuple[Footage, ...]
    calibrate: "CalibrateOptions | None" = None
    track: "TrackOptions | None" = None
    align: "AlignOptions | None" = None
    search: "SearchOptions | None" = None
    words: tuple[str, ...] = ()
    workers: Workers = Workers()
    every_s: float | None = None

    def whole(self, now_s: float) -> "Plan":
        """Without the clips that were changed within a minute of ``now_s`` (Unix time), or are
        gone.
        """
        cameras = []
        for one in self.cameras:
            ages = {clip: abs(now_s - changed) for clip, changed in _changed(one.clips)}
            clips = tuple(clip for clip, age_s in ages.items() if age_s >= _STILL_S)
            cameras.append(replace(one, clips=clips, recording=len(ages) - len(clips)))
        return replace(self, cameras=tuple(cameras))


def _changed(clips: Sequence[Path]) -> Iterator[tuple[Path, float]]:
    for clip in clips:
        with suppress(FileNotFoundError):  # it was removed meanwhile
            yield clip, clip.stat().st_mtime


def read_plan(path: str | Path) -> Plan:
    """Read a plan, or make one of a folder of clips. Raises :class:`InputError` naming file and
    field for whatever is not as it must be, also for footage and files that are not there.
    """
    from scene4d.alignment import AlignOptions
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.tracking import TrackOptions

    path = Path(path)
    base = path.parent.absolute()  # workers stand elsewhere
    if path.is_dir():
        return _of_folder(path.absolute())
    with in_file(path):
        said = JsonObject(load_yaml(read_text(path)), str(path))
    said.only(("cameras", *_STAGES, "workers", "every_s"))
    every_s = said.number("every_s", least=1.0, most=_MOST_S) if "every_s" in said else None
    again = every_s is not None
    cameras = said.object("cameras")
    if not cameras.names():
        raise said.error("cameras", "one camera or more")
    words, search = _search(said, base)
    plan = Plan(
        tuple(_footage(cameras, name, base, again=again) for name in cameras.names()),
        _stage(said, "calibrate", CalibrateOptions, base),
        _stage(said, "track", TrackOptions, base),
        _stage(said, "align", AlignOptions, base),
        search,
        words,
        _stage(said, "workers", Workers, base) or Workers(),
        every_s,
    )
    _check(plan, said)
    return plan


def _of_folder(folder: Path) -> Plan:
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.tracking import TrackOptions

    found = []
    for here in (folder, *sorted(one for one in folder.iterdir() if one.is_dir())):
        clips = sorted(one for one in here.iterdir() if one.suffix.lower() in VIDEO_SUFFIXES)
        known = here / _CAMERA
        if clips:
            name = here.resolve().name
            found.append(Footage(name, tuple(clips), camera=known if known.is_file() else None))
    if not found:
        endings = " ".join(sorted(VIDEO_SUFFIXES))
        raise InputError(f"{folder}: holds no clips ({endings}), nor do its folders")
    return Plan(tuple(found), calibrate=CalibrateOptions(), track=TrackOptions())


def _footage(cameras: JsonObject, name: str, base: Path, *, again: bool) -> Footage:
    said = cameras.object(name) if not isinstance(cameras.value(name), str | list) else None
    if said is None:
        return Footage(name, _clips(cameras, name, base, again=again))
    said.only(("footage", "boxes", "camera", "start"))
    if ("footage" in said) is ("boxes" in said):
        raise said.error("footage", "given, or boxes in its place, and not both")
    kind = "boxes" if "boxes" in said else "footage"
    camera = _beside(said.text("camera"), base) if "camera" in said else None
    if isinstance(camera, str):
        raise said.error("camera", "a camera file that is there")
    start = said.text("start") if "start" in said else None
    found = Footage(name, _clips(said, kind, base, again=again), kind == "boxes", camera, start)
    for clip in found.clips:
        found.begins(clip)
    return found


def _clips(said: JsonObject, name: str, base: Path, *, again: bool) -> tuple[Path, ...]:
    """The files that a text, or a list of texts, names; each once, in order of their names. A glob
    finds some, or may find them ``again`` later.
    """
    texts = (said.text(name),) if isinstance(said.value(name), str) else said.texts(name)
    found: set[Path] = set()
    for text in texts:
        try:
            here = base / text
            names = [str(here)] if here.is_file() else glob.glob(str(here), recursive=True)  # noqa: PTH207
        except (OSError, ValueError):
            names = []
        files = [Path(one) for one in names if Path(one).is_file()]
        if not files and not (again and glob.has_magic(text)):
            raise said.error(name, f"files that are there; nothing is at {quoted(text)}")
        found.update(files)
    if not texts:
        raise said.error(name, "a file, a glob, or a list of them")
    return tuple(sorted(found))


def _stage(said: JsonObject, name: str, kind: type[T], base: Path, *more: str) -> T | None:
    """The options of a stage, by the fields of their class; None where it is not wanted. What is
    ``more`` there is for others.
    """
    if said.value(name) is None:
        return None
    inside = said.object(name)
    hints = {key: hint for key, hint in get_type_hints(kind).items() if key not in _OWN}
    inside.only((*more, *hints))
    values = {key: _value(inside, key, hints[key], base) for key in inside.names() if key in hints}
    try:
        return kind(**values)
    except InputError as error:
        raise InputError(f"{inside.where}: field {name!r}: {error}") from error


def _value(said: JsonObject, name: str, hint: Any, base: Path) -> Any:
    """One option, of the type that its class declares; a file is relative to the plan."""
    kinds = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    if bool in kinds:
        return said.flag(name)
    if int in kinds:
        return said.integer(name)
    if float in kinds:
        return said.number(name)
    if Path in kinds:
        return _beside(said.text(name), base)
    if str in kinds:
        return said.text(name)
    if any(get_origin(one) is tuple for one in kinds):
        return tuple(int(one) for one in said.array(name, 2))
    return tuple(_beside(one, base) for one in said.texts(name))


def _beside(text: str, base: Path) -> str | Path:
    """A file of that name, or else the word that it is."""
    try:
        return base / text if (base / text).is_file() else text
    except (OSError, ValueError):  # too long a name, or none that a file can have
        return text


def _search(said: JsonObject, base: Path) -> tuple[tuple[str, ...], "SearchOptions | None"]:
    """What to search for, which must be understood, and how."""
    from scene4d.searching import SearchOptions, words_of

    options = _stage(said, "search", SearchOptions, base, "words")
    if options is None:
        return (), None
    words = said.object("search").texts("words")
    if not words:
        raise said.object("search").error("words", "one text or more, as 'person enters vehicle'")
    for one in words:
        try:
            words_of(one, options, None)
        except InputError as error:
            raise InputError(f"{said.where}: field 'search.words': {error}") from error
    return words, options


def _check(plan: Plan, said: JsonObject) -> None:
    """Raise :class:`InputError` where a stage lacks what it stands on."""
    wanted = [name for name in _STAGES if getattr(plan, name) is not None]
    if not wanted:
        raise InputError(f"{said.where}: nothing is to be done; add one of {', '.join(_STAGES)}")
    for name in ("align", "search"):
        if name in wanted and plan.track is None:
            raise InputError(f"{said.where}: field {name!r} needs tracks; add track: {{}}")
    try:
        names = {file_name(one.name, "camera").casefold() for one in plan.cameras}
    except InputError as error:
        raise InputError(f"{said.where}: field 'cameras': {error}") from error
    if len(names) < len(plan.cameras):
        raise InputError(f"{said.where}: field 'cameras': two names differ in case alone")
    for one in plan.cameras:
        if plan.track is not None and one.camera is None and plan.calibrate is None:
            raise InputError(
                f"{said.where}: field 'cameras.{one.name}.camera' is missing; give the camera's "
                "file, or add calibrate: {} to find it from footage"
            )
