"""P(near) of all pairs of objects in all frames: how many a second a core, beside peers.

    python -m benchmarks.predicates [--quick]

Every method gets the same positions and answers with the probability of every pair in every frame.
Time is that of the process, all its threads together; the fastest of several runs. DuckDB has no
error function: it gets the approximation 7.1.26 of Abramowitz and Stegun in SQL. PyMEOS (MobilityDB
in Python) has temporal distances and no probabilities: those of its distances are taken with SciPy,
and are counted. Where one of the two is not installed its rows are left out.
"""

import argparse
import importlib.util
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np
from scipy.special import erf

from benchmarks.tables import Rows, markdown
from scene4d.searching.predicates import NEAR_SIGMA_M, NEAR_TAU_M, near_pairs

AREA_M = 80.0
POSITION_SIGMA_M = 0.3
REPEATS = 5
EXACT = 1e-6


@dataclass(frozen=True, eq=False)
class Crowd:
    """n objects and m others over f frames. ``doubted``: with covariances."""

    name: str
    a: np.ndarray
    b: np.ndarray
    doubted: bool = False

    @property
    def pair_frames(self) -> int:
        return len(self.a) * self.b.shape[0] * self.b.shape[1]


Prepared = Callable[[], np.ndarray]
"""Answers (n, m, f) and is what is timed."""


def crowd(name: str, n: int, m: int, f: int) -> Crowd:
    rng = np.random.default_rng(1)
    a, b = (rng.uniform(-AREA_M / 2, AREA_M / 2, (k, f, 2)) for k in (n, m))
    return Crowd(name, a, b)


def _covariances(xy: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(2)
    root = POSITION_SIGMA_M * rng.normal(size=(*xy.shape[:2], 2, 2))
    return root @ root.swapaxes(-1, -2)


def ours(c: Crowd) -> Prepared:
    if not c.doubted:
        return lambda: near_pairs(c.a, c.b)
    of_a, of_b = _covariances(c.a), _covariances(c.b)
    return lambda: near_pairs(c.a, c.b, covariance_a=of_a, covariance_b=of_b)


def with_scipy(c: Crowd) -> Prepared:
    """As one would write it: whole arrays, ``scipy.special.erf``."""
    if not c.doubted:
        return lambda: _curve(np.linalg.norm(c.a[:, None] - c.b[None], axis=-1), NEAR_SIGMA_M)
    of_a, of_b = _covariances(c.a), _covariances(c.b)

    def run() -> np.ndarray:
        away = c.a[:, None] - c.b[None]
        d = np.linalg.norm(away, axis=-1)
        spread = of_a[:, None] + of_b[None]
        variance = np.einsum("nmfi,nmfij,nmfj->nmf", away, spread, away) / d**2
        return _curve(d, np.sqrt(NEAR_SIGMA_M**2 + variance))

    return run


def _curve(d: np.ndarray, sigma: np.ndarray | float) -> np.ndarray:
    return 0.5 * (1 - erf((d - NEAR_TAU_M) / (np.sqrt(2) * sigma)))


_SQL = """
with apart as (
    select a.who as i, b.who as j, a.frame as frame,
           (sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)) - {tau}) / {width} as z
    from a join b using (frame)
), tail as (
    select i, j, frame, z, 1 / (1 + 0.3275911 * abs(z)) as t from apart
), found as (
    select i, j, frame, z, t * (0.254829592 + t * (-0.284496736 + t * (1.421413741
        + t * (-1.453152027 + t * 1.061405429)))) * exp(-z * z) / 2 as p from tail
)
select i, j, frame, case when z < 0 then 1 - p else p end as near from found
"""


def with_duckdb(c: Crowd) -> Prepared:
    """One table per side, joined by frame; the answer comes as columns, in any order."""
    import duckdb

    connection = duckdb.connect()
    connection.execute("set threads to 1")
    for name, xy in (("a", c.a), ("b", c.b)):
        who, frame = (x.ravel() for x in np.indices(xy.shape[:2]))
        columns = {"who": who, "frame": frame, "x": xy[..., 0].ravel(), "y": xy[..., 1].ravel()}
        connection.register(f"{name}_columns", columns_table(columns))
        connection.execute(f"create table {name} as select * from {name}_columns")
    query = _SQL.format(tau=NEAR_TAU_M, width=np.sqrt(2) * NEAR_SIGMA_M)

    def run() -> np.ndarray:
        found = connection.execute(query).fetchnumpy()
        out = np.empty((len(c.a), len(c.b), c.a.shape[1]))
        out[found["i"], found["j"], found["frame"]] = found["near"]
        return out

    return run


def columns_table(columns: dict[str, np.ndarray]) -> object:
    import pyarrow

    return pyarrow.table(columns)


def with_pymeos(c: Crowd) -> Prepared:
    """Temporal points of every object, their temporal distances, and SciPy's erf."""
    import pymeos

    pymeos.pymeos_initialize()
    begin = datetime(2026, 1, 1)
    clock = [
        (begin + timedelta(milliseconds=100 * k)).isoformat(sep=" ") for k in range(c.a.shape[1])
    ]

    def points(xy: np.ndarray) -> list[object]:
        rows = [
            ",".join(
                f"Point({x!r} {y!r})@{t}" for (x, y), t in zip(one.tolist(), clock, strict=True)
            )
            for one in xy
        ]
        return [pymeos.TGeomPointSeq(f"{{{row}}}") for row in rows]

    first, second = points(c.a), points(c.b)

    def run() -> np.ndarray:
        d = np.array([[a.distance(b).values() for b in second] for a in first])
        return _curve(d, NEAR_SIGMA_M)

    return run


@dataclass(frozen=True)
class Method:
    name: str
    prepare: Callable[[Crowd], Prepared]
    needs: tuple[str, ...] = ()
    most: int = 1 << 62
    """Pair-frames that it gets at most, since it takes long."""
    doubts: bool = False

    @property
    def here(self) -> bool:
        return all(importlib.util.find_spec(name) for name in self.needs)


METHODS = (
    Method("near_pairs", ours, doubts=True),
    Method("numpy + scipy.special.erf", with_scipy, doubts=True),
    Method("DuckDB", with_duckdb, ("duckdb", "pyarrow"), most=4_000_000),
    Method("PyMEOS + scipy.special.erf", with_pymeos, ("pymeos",), most=400_000),
)


def seconds(run: Prepared, repeats: int) -> tuple[float, np.ndarray]:
    best, found = np.inf, np.empty(0)
    for _ in range(repeats):
        begun = time.process_time()
        found = run()
        best = min(best, time.process_time() - begun)
    return best, found


def shortened(c: Crowd, most: int) -> Crowd:
    """Fewer objects of the first kind, so that it stays below so many pair-frames."""
    keep = max(1, min(len(c.a), most // (c.pair_frames // len(c.a))))
    return replace(c, a=c.a[:keep])


def table(crowds: list[Crowd], repeats: int = REPEATS) -> Rows:
    """Millions of pair-frames a second, ratio to ours, greatest difference from SciPy's."""
    rows = [["pairs", "method", "pair-frames", "million a second", "ratio", "largest difference"]]
    for c in crowds:
        own = 0.0
        for method in METHODS:
            if not method.here or (c.doubted and not method.doubts):
                continue
            part = shortened(c, method.most)
            taken, found = seconds(method.prepare(part), repeats)
            rate = part.pair_frames / taken / 1e6
            own = own or rate
            away = float(np.abs(found - with_scipy(part)()).max())
            name = f"{c.name}, covariances" if c.doubted else c.name
            difference = "" if method.prepare is with_scipy else f"{away:.0e}"
            rows.append(
                [
                    name,
                    method.name,
                    f"{part.pair_frames:,}",
                    f"{rate:,.1f}",
                    f"{own / rate:.1f}",
                    difference,
                ]
            )
    return rows


def crowds(scale: int) -> list[Crowd]:
    plain = [
        crowd("3,000 x 3,000, one frame", 3000 // scale, 3000, 1),
        crowd("100 x 50, 2,000 frames", 100 // scale, 50, 2000),
    ]
    return [*plain, *(replace(c, doubted=True) for c in plain)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a smoke run")
    quick = parser.parse_args().quick
    for method in METHODS:
        if not method.here:
            print(f"{method.name}: not installed, left out", file=sys.stderr)
    print(markdown(table(crowds(30 if quick else 1), 1 if quick else REPEATS)))


if __name__ == "__main__":
    main()
