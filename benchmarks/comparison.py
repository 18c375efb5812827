"""Accuracy and time of all methods on the same scenes."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.peers import Method
from benchmarks.scenes import Scene
from benchmarks.tables import Rows

FAILED_M = 10.0
"""A camera that errs by more than this is nonsense."""


@dataclass(frozen=True)
class Attempt:
    """``error_m`` is infinite for a failure and None for a refusal; ``focal_error`` is relative."""

    method: Method
    condition: str
    seconds: float
    error_m: float | None
    focal_error: float | None


def attempt(method: Method, scene: Scene) -> Attempt:
    """One method on one scene; whatever it raises is a failure."""
    begun = time.perf_counter()
    try:
        camera = method.solve(scene)
    except Exception:
        camera, error = None, float("inf")
    else:
        error = None if camera is None else 0.0
    seconds = time.perf_counter() - begun
    if camera is None:
        return Attempt(method, scene.condition, seconds, error, None)
    try:
        error = scene.error(camera).mean_m
    except ValueError:  # a correspondence point above its horizon
        error = float("inf")
    if not error <= FAILED_M:
        return Attempt(method, scene.condition, seconds, float("inf"), None)
    off = abs(camera.focal_px / scene.focal_px - 1)
    return Attempt(method, scene.condition, seconds, error, off)


def compare(methods: Sequence[Method], scenes: list[Scene]) -> list[Attempt]:
    """All attempts, scene by scene, so that a busy moment hits every method.

    Each is called once beforehand, so that nobody pays for imports; the samplers, which take
    seconds, are not: ``fit`` has imported what they need.
    """
    for method in methods:
        if method.seeds is None:
            attempt(method, scenes[0])
    return [
        attempt(method, scene)
        for scene in scenes
        for method in methods
        if method.seeds is None or scene.seed < method.seeds
    ]


def table(attempts: list[Attempt]) -> Rows:
    """One row for every condition and method; the first method is the measure of time."""
    rows: Rows = [
        ["people", "method", "focal length", "scenes", "refused", "failed", "error, median",
         "90 %", "focal error", "time, ms", "ratio"],
    ]  # fmt: skip
    ratio = {}
    for (condition, method), mine in grouped(attempts).items():
        milliseconds = 1e3 * statistics.median(a.seconds for a in mine)
        unit = ratio.setdefault(condition, milliseconds)
        errors = [a.error_m for a in mine if a.error_m is not None]
        focal = [a.focal_error for a in mine if a.focal_error is not None]
        median, tail = quantiles(errors)
        refused, failed = len(mine) - len(errors), int(np.isinf(errors).sum())
        off = "" if method.told_focal or not focal else f"{statistics.median(focal):.1%}"
        rows.append(
            [condition, method.name, "given" if method.told_focal else "found", f"{len(mine)}",
             f"{refused}", f"{failed}", metres(median), metres(tail), off,
             number(milliseconds), number(milliseconds / unit)]
        )  # fmt: skip
    return rows


def grouped(attempts: list[Attempt]) -> dict[tuple[str, Method], list[Attempt]]:
    """By condition, then method, in the order of the first attempts of each condition."""
    groups: dict[tuple[str, Method], list[Attempt]] = {}
    for condition in dict.fromkeys(a.condition for a in attempts):
        for one in attempts:
            if one.condition == condition:
                groups.setdefault((condition, one.method), []).append(one)
    return groups


def quantiles(errors: list[float]) -> tuple[float, float]:
    """Median and 90th percentile, failures being infinite; NaN where all were refused."""
    if not errors:
        return float("nan"), float("nan")
    median, tail = np.quantile(errors, [0.5, 0.9], method="higher")
    return float(median), float(tail)


def number(value: float) -> str:
    """Two digits, or all of a whole number."""
    return f"{value:.2g}" if value < 99.5 else f"{value:,.0f}"


def metres(error: float) -> str:
    if np.isnan(error):
        return ""
    return f"{error:.2f} m" if np.isfinite(error) else f"> {FAILED_M:.0f} m"
