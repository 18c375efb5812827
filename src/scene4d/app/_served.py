"""What a server holds: scenes that may still grow, their footage as browsers play it, zones."""

import tempfile
import threading
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from scene4d.app._contents import (
    camera_of,
    contents,
    places_json,
    run_of,
    told_event,
    watched_events,
)
from scene4d.app._fleet import fleet_of, picture_of
from scene4d.app._footage import plays, view_of
from scene4d.app._opened import Opened, Shown
from scene4d.app._page import page_html
from scene4d.app._pieces import PieceStore
from scene4d.app._rows import rows_of
from scene4d.core.errors import InputError
from scene4d.core.files import write_bytes, write_json
from scene4d.searching import read_places
from scene4d.searching.kept import ZONES, drop_search, keep_search, kept_searches
from scene4d.store.footage import NoFootage, footage_of
from scene4d.store.runs import file_name, manifest_path
from scene4d.store.site_file import SITE_FILE, SiteFile, is_site
from scene4d.video.reader import open_source


class Served:
    """The scenes of one server. Its methods may be called from several threads.

    Runs are numbered in the order in which they were seen; none is ever numbered again. ``ending``
    says that connections which wait for what is new shall end.
    """

    def __init__(self, folders: list[Path], footage: Path | None, zones: Path | None) -> None:
        self._folders, self._given = folders, footage
        self._zones = folders[0] / ZONES if zones is None else zones
        self.ending = False
        self._lock = threading.Lock()
        self._viewing = threading.Lock()
        self._pieces = PieceStore()
        self._names: list[str] = []
        self._stamp: Any = None
        self._sites: list[tuple[str, int, int]] = []
        self._scenes: list[Path] = []  # of these sites
        self._opened: Opened
        self._shown: dict[str, Shown] = {}
        self.refresh()
        self._made = tempfile.TemporaryDirectory(prefix="scene4d-")

    def close(self) -> None:
        """Remove what was made for it."""
        self._made.cleanup()

    def refresh(self) -> list[dict[str, Any]]:
        """Read manifests that have changed; returns all runs in brief."""
        with self._lock:
            self._current()
            numbers = {name: number for number, name in enumerate(self._names)}
            return [run_of(one) | {"number": numbers[name]} for name, one in self._shown.items()]

    def _current(self) -> Opened:
        """What there is now; the caller holds the lock. A stream replaces what it published each
        second, so whoever asks is answered from the newest manifests.
        """
        stamp = self._manifests()
        if stamp != self._stamp:
            opened = Opened(self._folders, growing=True)
            shown = {_key(one): one for one in opened.shown}
            self._names += [name for name in shown if name not in self._names]
            self._opened, self._shown, self._stamp = opened, shown, stamp
        return self._opened

    def _manifests(self) -> list[tuple[str, int, int]]:
        """Names, times and sizes of files that change with a run or a site."""
        sites = [folder for folder in self._folders if is_site(folder)]
        stamp = _about(folder / SITE_FILE for folder in sites)
        if stamp != self._sites:
            cameras = [one for site in sites for one in SiteFile.load(site).cameras.values()]
            self._sites, self._scenes = stamp, sorted({one.scene for one in cameras})
        folders = [*self._folders, *self._scenes]
        return stamp + _about(one for f in folders for one in sorted((f / "runs").glob("*.json")))

    def page(self) -> str:
        """The page, which asks for everything else."""
        return page_html(self.contents() | {"api": "api"})

    def contents(self) -> dict[str, Any]:
        """Cameras, runs and what was told of them, without rows."""
        with self._lock:
            opened = self._current()
            numbered = [(n, self._shown.get(name)) for n, name in enumerate(self._names)]
        runs = [self._run(one) | {"number": n} for n, one in numbered if one is not None]
        said = contents(self._folders, opened, runs) | {"fleet": fleet_of(opened, self._folders)}
        return said | {"searches": [], "places": None, "fused": None}

    def fleet(self) -> list[dict[str, Any]]:
        """What each camera does now."""
        with self._lock:
            opened = self._current()
        return fleet_of(opened, self._folders)

    def now(self, number: int) -> Path:
        """The newest small picture of a run's camera; raises :class:`LookupError`."""
        shown = self._named(number)
        with self._lock:
            opened = self._current()
        path = picture_of(opened, self._folders, shown.camera)
        if path is None:
            raise LookupError(f"camera {shown.camera} is not watched")
        return path

    def _run(self, shown: Shown) -> dict[str, Any]:
        place = self._place(shown)
        there = not isinstance(place, NoFootage)
        watched = [e for folder in self._folders for e in watched_events(folder, shown.run)]
        note = place.reason if isinstance(place, NoFootage) else None
        return run_of(shown) | {"watched": watched, "note": note, "video": there, "view": there}

    def _place(self, shown: Shown) -> Path | NoFootage:
        return footage_of(shown.run, self._given, alone=len(self._shown) == 1)

    def _named(self, number: int) -> Shown:
        with self._lock:
            self._current()
            if not 0 <= number < len(self._names) or self._names[number] not in self._shown:
                raise LookupError(f"no run {number}")
            return self._shown[self._names[number]]

    def rows(self, number: int, since_s: float | None) -> dict[str, Any]:
        """The rows of a run; raises :class:`LookupError` where there is none."""
        shown = self._named(number)
        with self._lock:
            return rows_of(self._opened.tracks(shown, since_s))

    def fused(self) -> dict[str, Any]:
        """Rows of everybody once; raises :class:`LookupError` where this is no site."""
        with self._lock:
            tracks = self._current().fused()
        if tracks is None:
            raise LookupError("cameras of scenes share no ground; align makes a site of them")
        return rows_of(tracks)

    def video(self, number: int) -> Path:
        """A file that browsers play; raises :class:`LookupError` where there is none."""
        place = self._footage(number)
        if not plays(place):
            raise LookupError("browsers cannot play this footage as it is; ask for its pieces")
        return place

    def pieces(self, number: int) -> dict[str, Any]:
        """Where pieces of footage begin, or null where the file plays as it is.

        Raises :class:`LookupError` and :class:`InputError` where there is none.
        """
        place = self._footage(number)
        if plays(place):
            return {"starts_s": None}
        return self._pieces.of(place, self._named(number).calibration.image_size).about()

    def piece(self, number: int, piece: int) -> tuple[bytes, float]:
        """One of them as MP4, and what to add to its times (s); raises as :meth:`pieces`."""
        image_size = self._named(number).calibration.image_size
        return self._pieces.piece(self._footage(number), image_size, piece)

    def view(self, number: int) -> bytes:
        """What the empty view looks like, as JPEG; raises as :meth:`video`."""
        made = Path(self._made.name) / f"{number}.jpg"
        place = self._footage(number)
        with self._viewing:
            if not made.exists():
                with open_source(place) as source:
                    write_bytes(made, view_of(source) or b"")
        return made.read_bytes()

    def _footage(self, number: int) -> Path:
        place = self._place(self._named(number))
        if isinstance(place, NoFootage):
            raise LookupError(place.reason)
        return place

    def to_calibrate(
        self, number: int, said: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """What it takes to calibrate a run's camera with what is ``said`` of it, and what it is
        compared with. Raises :class:`LookupError` where there is no footage.
        """
        shown, source = self._named(number), self._footage(number)
        with self._lock:
            before, site = self._current().own(shown), self._opened.site
        runs = (f for f in self._folders if site or manifest_path(f, shown.run.run).is_file())
        annotations = shown.run.provenance.get("annotations")
        values = {
            "source": str(source),
            "annotations": annotations if isinstance(annotations, str) else None,
            "person_height_m": before.person_height_m,
            "said": said,
            "out": str(next(runs) / "judged" / file_name(shown.camera, "camera")),
        }
        return values, {"run": number, "before": camera_of(before)}

    def asked(self, words: str, options: dict[str, Any]) -> dict[str, Any]:
        """A search for a process of its own, with the zones that are saved."""
        zones = str(self._zones) if self._zones.is_file() else None
        folders = [str(folder) for folder in self._folders]
        return {"folders": folders, "words": words, "options": options | {"zones": zones}}

    def places(self) -> dict[str, Any]:
        """Zones and lines as their file holds them; empty where there is none."""
        if not self._zones.is_file():
            return {}
        with self._lock:
            return places_json(read_places(self._zones, self._current().cameras))

    def save_places(self, said: dict[str, Any]) -> None:
        """Check zones and lines, and write their file; raises :class:`InputError`."""
        if not any(said.values()):
            self._zones.unlink(missing_ok=True)
            return
        with tempfile.TemporaryDirectory(dir=self._made.name) as folder:
            probe = Path(folder) / "zones"
            write_json(probe, said)
            with self._lock:
                cameras = self._current().cameras
            try:
                read_places(probe, cameras)
            except InputError as error:
                raise InputError(str(error).replace(f"{probe}", "zones")) from None
        write_json(self._zones, said)

    def alerts(self) -> list[str]:
        """Searches that whoever watches these scenes looks for."""
        return list(dict.fromkeys(one for folder in self._folders for one in kept_searches(folder)))

    def keep_alert(self, words: str) -> None:
        """Keep a search in the scenes; raises :class:`InputError` for what cannot stand there."""
        with self._lock:
            if self._current().site is not None:
                raise InputError("nobody watches a site; serve its scenes to keep a search there")
            for folder in self._folders:
                keep_search(folder, words, self._opened.cameras)

    def drop_alert(self, words: str) -> None:
        """Keep it no longer."""
        with self._lock:
            for folder in self._folders:
                drop_search(folder, words)

    def told(self, from_bytes: dict[str, int]) -> list[str]:
        """What ``watch`` has told since, one JSON object each; ``from_bytes`` moves on."""
        found = []
        for folder in self._folders:
            for path in sorted((folder / "events").glob("*.jsonl")):
                size, before = path.stat().st_size, from_bytes.get(str(path), 0)
                if size <= before:
                    continue
                with path.open("rb") as file:
                    file.seek(before)
                    text = file.read(size - before)
                whole = text[: text.rfind(b"\n") + 1]
                from_bytes[str(path)] = before + len(whole)
                lines = whole.decode("utf-8", "replace").splitlines()
                found += [line for line in lines if told_event(line) is not None]
        return found

    def told_so_far(self) -> dict[str, int]:
        """Where the files of what was told end at the moment."""
        sizes: dict[str, int] = {}
        self.told(sizes)
        return sizes


def _about(paths: Iterable[Path]) -> list[tuple[str, int, int]]:
    """Names, times and sizes of files."""
    found = []
    for path in paths:
        with suppress(FileNotFoundError):  # removed since it was listed
            about = path.stat()
            found.append((str(path), about.st_mtime_ns, about.st_size))
    return found


def _key(shown: Shown) -> str:
    """Names a run for good: cameras of a site may have runs of one name."""
    return f"{shown.camera}\n{shown.run.run}"
