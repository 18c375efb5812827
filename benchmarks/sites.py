"""How well cameras of made sites are aligned, how well they know it, and what it costs.

    python -m benchmarks.sites [--quick] [--write] [--only pairs nobody sites hour cameras between]

Made sites (tests/alignment/worlds.py): people with stops and turns in a street, cameras with wrong
focal length, tilt, roll, height, distortion and principal point, clocks minutes apart, frame rates
of 5 to 12.5 Hz, 15 % of the time missed, 10 % false tracks. With --write the tables replace what
stands between the markers in docs/alignment.md.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from alignment.worlds import Site, made_site
from benchmarks.tables import Rows, markdown
from scene4d.alignment._graph import Solution, solve
from scene4d.alignment._joint import errors_together, refined
from scene4d.alignment._pairs import Link, link
from scene4d.alignment._paths import View, view_of
from scene4d.core.calibration import Calibration

PAGE = Path(__file__).parents[1] / "docs" / "alignment.md"
SECTIONS = ("pairs", "nobody", "sites", "hour", "cameras", "between")
INSIDE = 1.96
WRONG_M, WRONG_S = 5.0, 2.0
"""An alignment further off than this found other people."""


def views_of(site: Site) -> list[View]:
    views = [view_of(one.name, one.tracks, one.calibration) for one in site.seen]
    for view in views:
        len(view.paths)  # worked out once per camera, not per pair
    return views


def links_of(views: Sequence[View]) -> list[Link]:
    pairs = combinations(range(len(views)), 2)
    return [link(views[i], views[j], (i, j)) for i, j in pairs]


def errors(site: Site, solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Estimate less truth (n, 5) of placed cameras but the first, and the same in sigmas."""
    apart, sigmas = [], []
    truths = zip(site.seen[1:], solution.placements[1:], site.drift[1:], strict=True)
    for one, placement, rate in truths:
        if placement and solution.placements[0]:
            step = placement.parameters - one.truth.parameters
            if placement.drift is not None:
                step[4] -= rate * placement.drift.at_s
            step[2] = np.angle(np.exp(1j * step[2]))
            apart.append(step)
            sigmas.append(step / np.sqrt(np.diag(placement.covariance)))
    return np.array(apart).reshape(-1, 5), np.array(sigmas).reshape(-1, 5)


def _row(apart: np.ndarray, sigmas: np.ndarray) -> list[str]:
    """Median errors and shares inside 95 % intervals."""
    if not len(apart):
        return ["-"] * 5
    place = np.median(np.hypot(*apart[:, :2].T))
    inside = (np.abs(sigmas) < INSIDE).mean()
    return [
        f"{place:.2f} m",
        f"{np.degrees(np.median(np.abs(apart[:, 2]))):.1f}°",
        f"{np.median(np.abs(apart[:, 3])) * 100:.1f} %",
        f"{np.median(np.abs(apart[:, 4])):.3f} s",
        f"{inside * 100:.0f} %",
    ]


HEAD = ["position", "heading", "scale", "offset", "inside 95 %"]


def _wrong(apart: np.ndarray) -> int:
    far = np.hypot(*apart[:, :2].T) > WRONG_M
    return int((far | (np.abs(apart[:, 4]) > WRONG_S)).sum())


def pairs(seeds: int) -> Rows:
    rows: Rows = [["overlap", "sites", "found", "wrong", *HEAD, "processor time"]]
    for overlap in (0.0, 0.2, 0.4, 0.6):
        apart, sigmas, spent = [], [], []
        for seed in range(seeds):
            site = made_site(seed, overlap=overlap)
            views = views_of(site)
            start = time.process_time()
            found = link(*views)
            spent.append(time.process_time() - start)
            if found:
                a, s = errors(site, solve(views, [found]))
                apart.append(a)
                sigmas.append(s)
        a, s = (np.concatenate([*x, np.zeros((0, 5))]) for x in (apart, sigmas))
        cost = f"{np.mean(spent):.2f} s"
        row = [f"{overlap * 100:.0f} %", str(seeds), f"{len(apart)}", f"{_wrong(a)}"]
        rows.append([*row, *_row(a, s), cost])
    return rows


def nobody(seeds: int) -> Rows:
    """Two cameras 35 m apart along a street: the same people, but never in both at one time."""
    rows: Rows = [["minutes", "sites", "called aligned", "highest score", "processor time"]]
    for minutes in (1.0, 3.0, 8.0):
        found, score, spent = 0, -np.inf, []
        for seed in range(seeds):
            views = views_of(made_site(1000 + seed, overlap=-1.5, minutes=minutes))
            start = time.process_time()
            said = link(*views)
            spent.append(time.process_time() - start)
            found += bool(said)
            score = max(score, said.score)
        cost = f"{np.mean(spent):.2f} s"
        rows.append([f"{minutes:.0f}", str(seeds), str(found), f"{score:.1f}", cost])
    return rows


def _solved(site: Site) -> tuple[list[View], list[Link], Solution, float]:
    views = views_of(site)
    start = time.process_time()
    links = links_of(views)
    solution = solve(views, links)
    return views, links, solution, time.process_time() - start


def sites(seeds: int) -> Rows:
    rows: Rows = [["cameras", "sites", "placed", "wrong", *HEAD, "processor time"]]
    for cameras in (2, 5, 10):
        apart, sigmas, spent, placed, total = [], [], [], 0, 0
        for seed in range(max(1, seeds // cameras)):
            site = made_site(seed, cameras=cameras, overlap=0.5, minutes=5.0, per_minute=6.0)
            _, _, solution, cost = _solved(site)
            a, s = errors(site, solution)
            apart.append(a)
            sigmas.append(s)
            spent.append(cost)
            placed += sum(map(bool, solution.placements))
            total += cameras
        a, s = np.concatenate(apart), np.concatenate(sigmas)
        row = [str(cameras), str(len(spent)), f"{placed} of {total}", str(_wrong(a))]
        rows.append([*row, *_row(a, s), f"{np.mean(spent):.1f} s"])
    return rows


def hour(cameras: int, minutes: float, seeds: Sequence[int]) -> Rows:
    """The largest sites, with clocks that drift."""
    rows: Rows = [
        ["cameras", "minutes", "tracks", "pairs joined", "placed", *HEAD, "drift", "time"]
    ]
    for seed in seeds:
        site = made_site(
            seed, cameras=cameras, overlap=0.5, minutes=minutes, per_minute=1.5, drift_ppm=80.0
        )
        views, links, solution, cost = _solved(site)
        there = np.array([bool(one) for one in solution.placements])
        rates = [0.0 if one.drift is None else one.drift.rate for one in solution.placements]
        drift = 1e6 * np.abs(rates - site.drift)[there]
        tracks = sum(len(np.unique(view.track)) for view in views)
        row = [str(cameras), f"{minutes:.0f}", f"{tracks:,}", f"{sum(map(bool, links))}"]
        row += [f"{there.sum()}", *_row(*errors(site, solution)), f"{np.median(drift):.0f} ppm"]
        rows.append([*row, f"{cost:.0f} s"])
    return rows


def _ground_error_m(calibration: Calibration, one: object) -> float:
    uv, _ = one.calibration.ground_pixels(one.tracks.xy_m[::5])  # type: ignore[attr-defined]
    true = one.camera.locate(uv)[0]  # type: ignore[attr-defined]
    assert calibration.camera is not None
    step = calibration.camera.locate(uv)[0] - true
    return float(np.sqrt((step**2).sum(axis=1).mean()))


def cameras(seeds: int) -> Rows:
    """Errors of the cameras' own ground, before and after they are refined together."""
    rows: Rows = [["cameras", "sites", "alone", "together", "better", "sigma: rms"]]
    for count in (2, 4):
        before, after, z = [], [], []
        for seed in range(max(1, seeds // count)):
            site = made_site(seed, cameras=count, overlap=0.5)
            views, _, solution, _ = _solved(site)
            for one, found in zip(site.seen, refined(views, solution), strict=True):
                if found is None or found.calibration.camera is None:
                    continue
                before.append(_ground_error_m(one.calibration, one))
                after.append(_ground_error_m(found.calibration, one))
                said, true = found.calibration.camera, one.camera
                assert found.calibration.covariance is not None
                step = [
                    np.log(said.focal_px / true.focal_px),
                    said.tilt_rad - true.tilt_rad,
                    said.roll_rad - true.roll_rad,
                    np.log(said.height_m / true.height_m),
                ]
                z.append(np.array(step) / np.sqrt(np.diag(found.calibration.covariance))[:4])
        better = np.mean(np.array(after) < np.array(before))
        row = [str(count), str(max(1, seeds // count)), f"{np.median(before):.2f} m"]
        row += [f"{np.median(after):.2f} m", f"{better * 100:.0f} %"]
        rows.append([*row, f"{np.sqrt(np.mean(np.square(z))):.2f}"])
    return rows


def between(seeds: int) -> Rows:
    """Ways from what one camera sees to what another sees, at places of people: by what both err by
    together, and by what each states.
    """
    rows: Rows = [["cameras", "pairs", "error", "sigma", "z: rms", "sigma by each", "z: rms"]]
    for count in (2, 4):
        off: list[np.ndarray] = []
        told: dict[str, list[np.ndarray]] = {"together": [], "alone": []}
        for seed in range(max(1, seeds // count)):
            site = made_site(seed, cameras=count, overlap=0.5)
            views, _, solution, _ = _solved(site)
            seen = _seen_from_each(site, views, solution)
            for (a, mine, own), (b, modes, other) in combinations(seen, 2):
                by = modes - mine
                off.append(b - a)
                told["together"].append(by @ by.swapaxes(1, 2))
                told["alone"].append(own + other)
        error = np.concatenate(off)
        row = [str(count), str(len(off)), f"{np.median(np.hypot(*error.T)):.2f} m"]
        for covariances in told.values():
            covariance = np.concatenate(covariances)
            q = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
            sigma = np.median(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))
            row += [f"{sigma:.2f} m", f"{np.sqrt(q.mean() / 2):.2f}"]
        rows.append(row)
    return rows


def _seen_from_each(
    site: Site, views: Sequence[View], solution: Solution
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each placed camera, at 40 places: errors in the site, modes, and what it states alone."""
    errors, found = errors_together(views, solution), []
    for one, better in zip(site.seen, refined(views, solution), strict=True):
        if better is None or better.calibration.camera is None:
            continue
        placement, known = better.placement, better.calibration
        rows = np.linspace(0, len(one.tracks) - 1, 40).astype(int)
        uv, _ = one.calibration.ground_pixels(one.tracks.xy_m[rows])
        assert known.camera is not None
        xy, true = known.camera.locate(uv)[0], one.camera.locate(uv)[0]
        first = one is site.seen[0]
        there = true if first else replace(one.truth, scale=1.0).points(true)
        shared, _ = known.ground_covariance(uv, from_camera=True)
        alone = placement.own_covariances(shared) + placement.point_covariances(xy)
        modes = errors.modes_m(one.name, placement, known, xy)
        found.append((placement.points(xy) - there, modes, alone))
    return found


def tables(wanted: Sequence[str], seeds: int, quick: bool) -> Iterator[tuple[str, Rows]]:
    if "pairs" in wanted:
        yield "pairs", pairs(seeds)
    if "nobody" in wanted:
        yield "nobody", nobody(seeds // 2)
    if "sites" in wanted:
        yield "sites", sites(seeds // 2)
    if "cameras" in wanted:
        yield "cameras", cameras(seeds)
    if "between" in wanted:
        yield "between", between(seeds)
    if "hour" in wanted:
        yield "hour", hour(4, 10.0, (1,)) if quick else hour(20, 60.0, (1, 2, 3))


def put(name: str, text: str) -> None:
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    page = PAGE.read_text()
    before, after = page[: page.index(begin) + len(begin)], page[page.index(end) :]
    PAGE.write_text(f"{before}\n{text}\n{after}")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.sites",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS)
    parser.add_argument("--seeds", type=int, default=60)
    parser.add_argument("--quick", action="store_true", help="little work, nothing to be written")
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    asked = parser.parse_args()
    if asked.quick and asked.write:
        parser.error("--quick measures too little to be written into the page")
    for name, rows in tables(asked.only, 6 if asked.quick else asked.seeds, asked.quick):
        text = markdown(rows)
        print(f"\n{name}\n{text}", flush=True)
        if asked.write:
            put(name, text)


if __name__ == "__main__":
    main()
