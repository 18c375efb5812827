"""What NIST's scorer asks of a system's output (ActEV evaluation plan, protocol ActEV_SDL_V2)."""

import re
from typing import Any

_FILE = re.compile(r"[A-Za-z0-9_.-]+")
_FRAME = re.compile(r"-?\d+")


def faults(values: Any) -> list[str]:
    """Everything that the scorer would refuse, or count wrongly; empty for a good output."""
    if not isinstance(values, dict) or not {"filesProcessed", "activities"} <= set(values):
        return ["no object with filesProcessed and activities"]
    files = values["filesProcessed"]
    found = [f"file {one!r}" for one in files if not _FILE.fullmatch(one)]
    found += ["a file twice"] if len(set(files)) < len(files) else []
    statuses = values.get("processingReport", {}).get("fileStatuses", {})
    found += [] if list(statuses) == files else ["statuses of other files"]
    for one in statuses.values():
        good = all(isinstance(one.get(key), str) for key in ("status", "message"))
        found += [] if good else [f"status {one}"]
    for one in values["activities"]:
        found += [f"{fault}: {one}" for fault in _instance_faults(one, files)]
    numbers = [one.get("activityID") for one in values["activities"]]
    found += [] if len(set(numbers)) == len(numbers) else ["an activityID twice"]
    return found


def _instance_faults(one: dict[str, Any], files: list[str]) -> list[str]:
    kinds = {"activity": str, "activityID": int, "presenceConf": float, "localization": dict}
    wrong = [key for key, kind in kinds.items() if type(one.get(key)) is not kind]
    if wrong:
        return [f"{key} is missing or no {kinds[key].__name__}" for key in wrong]
    found = [] if len(one["localization"]) == 1 else ["not in one file"]
    for file, signal in one["localization"].items():
        found += [] if file in files else ["in a file that was not processed"]
        frames = [frame for frame in signal if _FRAME.fullmatch(frame)]
        found += [] if len(frames) == len(signal) >= 2 else ["frames"]
        values = [signal[frame] for frame in sorted(frames, key=int)]
        good = values[:1] == [1] and values[-1:] == [0] and {*map(type, values)} == {int}
        found += [] if good else ["signal"]
    return found
