"""What a page shows: cameras with their uncertainty, runs with rows, events and footage."""

import hashlib
import json
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.app._opened import Opened, Shown
from scene4d.core import geometry
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.text import quoted
from scene4d.searching import FoundEvent, Places, SearchResult
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.store.runs import Run, file_name, iso_ms

VIEW_SCHEMA = "scene4d/view/1"
_MOST_NAMED = 3
"""Cameras that a title names."""
_MOST_EVENTS = 500
"""Most events of one run in a page; more marks on its timeline cannot be told apart."""


def camera_of(calibration: Calibration) -> dict[str, Any]:
    """A camera with all that its page computes with; angles in radians, lengths in metres."""
    camera = calibration.camera
    assert camera is not None
    known = calibration.covariance is not None
    return {
        "image_size": list(camera.image_size),
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
        "distortion_model": camera.distortion_model,
        "R": camera.R.tolist(),
        "t": camera.t.tolist(),
        "focal_px": camera.focal_px,
        "tilt_rad": camera.tilt_rad,
        "roll_rad": camera.roll_rad,
        "height_m": camera.height_m,
        "sigma": calibration.sigma,
        "covariance": calibration.parameter_covariance.tolist() if known else None,
        "regions": [region.to_dict() for region in calibration.ground_regions],
        "person_height_m": calibration.person_height_m,
        "method": calibration.method,
        "people": calibration.people,
        "inliers": calibration.inliers,
        "ground_error_m": calibration.ground_error_m,
        "warnings": list(calibration.warnings),
        "horizon": geometry.horizon_line(camera.K, camera.R).tolist(),
        "source": (calibration.made or {}).get("source"),
    }


def run_of(shown: Shown) -> dict[str, Any]:
    """A run in brief, on the page's clock; its rows, footage and events come beside it. ``version``
    changes with the rows; a stream's newest part is hidden while it is ``growing``.
    """
    run = shown.run
    begin_s, end_s = shown.span_s
    return {
        "run": run.run,
        "camera": shown.camera,
        "start": None if shown.start is None else iso_ms(shown.start),
        "shift_s": shown.shift_s,
        "begin_s": begin_s,
        "end_s": end_s,
        "rows": run.rows,
        "version": hashlib.sha256(repr(run.parts).encode()).hexdigest()[:16],
        "growing": any(part.is_hidden for part in run.parts),
        "classes": run.classes,
        "step_s": 1.0 / _rate_hz(run),
        "lost": [[a + shown.shift_s, b + shown.shift_s] for a, b in _lost(run)],
    }


def _rate_hz(run: Run) -> float:
    rate = run.provenance.get("rate_hz")
    return float(rate) if isinstance(rate, int | float) and rate > 0 else 10.0


def _lost(run: Run) -> list[list[float]]:
    """Spans (s) of a run in which nothing was recorded: as its manifest
    says, else between its parts.
    """
    if run.watched is not None:
        return [[before[1], after[0]] for before, after in pairwise(run.watched)]
    spans = sorted((part.begin_s, part.end_s) for part in run.parts)
    longest = max(2.0, 4 / _rate_hz(run))
    return [
        [before[1], after[0]] for before, after in pairwise(spans) if after[0] - before[1] > longest
    ]


def event_of(found: FoundEvent) -> dict[str, Any]:
    """An event as ``search --json`` prints it, and its predicates over time where they are kept."""
    said = found.to_dict()
    if found.course is not None:
        said["course"] = {
            "time_s": [round(float(s), 2) for s in found.course.time_s],
            "values": {
                name: [None if np.isnan(p) else round(float(p), 3) for p in values]
                for name, values in found.course.values.items()
            },
        }
    return said


def search_of(result: SearchResult) -> dict[str, Any]:
    """A search: the words, what they were understood as, and its events."""
    from scene4d.searching.language import explain

    query = result.asked.query
    return {
        "words": query.text,
        "understood": list(explain(query.activity, query.window, ())),
        "verdict": result.verdict,
        "notes": [*result.asked.notes, *result.about_scores],
        "events": [event_of(found) for found in result.events[:_MOST_EVENTS]],
    }


def watched_events(folder: Path, run: Run) -> list[dict[str, Any]]:
    """What ``watch`` told of a run, each event as told last, without those withdrawn. A line that
    does not end is being written, or was when ``watch`` was killed.
    """
    path = folder / "events" / f"{file_name(run.run, 'run')}.jsonl"
    if not path.is_file():
        return []
    told: dict[str, dict[str, Any]] = {}
    lines = path.read_bytes().split(b"\n")[:-1]
    for number, line in enumerate((one.decode("utf-8", "replace") for one in lines), 1):
        event = told_event(line)
        if event is None:
            raise InputError(f"{path}: line {number}: no event: {quoted(line)}")
        told[event["id"]] = event
    kept = [event for event in told.values() if event.get("state") != "withdrawn"]
    return kept[-_MOST_EVENTS:]


def told_event(line: str) -> dict[str, Any] | None:
    """A line of what ``watch`` told; None where it is not as ``watch`` writes it."""
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict):
        return None
    kinds: dict[Any, tuple[str, ...]] = {
        str: ("id", "activity", "state", "run"),
        dict: ("roles", "why"),
        int | float: ("begin_s", "end_s", "score"),
    }
    fits = all(isinstance(event.get(name), kind) for kind, names in kinds.items() for name in names)
    return event if fits else None


def contents(folders: list[Path], opened: Opened, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The object that a page is made of."""
    cameras = opened.cameras
    many = len(cameras) > _MOST_NAMED
    names = [folder.resolve().name for folder in folders]
    names += [f"{len(cameras)} cameras"] if many else cameras
    return {
        "schema": VIEW_SCHEMA,
        "version": version("scene4d"),
        "title": ", ".join(names),
        "site": opened.site is not None,
        "unplaced": opened.unplaced,
        "phrases": [next(iter(one.phrases), name) for name, one in load_catalogue().items()],
        "cameras": {
            one.camera: camera_of(one.calibration) | opened.placement(one.camera)
            for one in opened.shown
        },
        "anchor": opened.anchor,
        "runs": runs,
    }


def places_json(places: Places) -> dict[str, Any]:
    """Zones and lines as a file of them holds them."""
    said: dict[str, Any] = {}
    for place in places.all:
        camera = {} if place.camera is None else {"camera": place.camera}
        points = {"points": place.points.tolist()}
        said.setdefault(f"{place.kind}s", {})[place.name] = camera | points
    return said
