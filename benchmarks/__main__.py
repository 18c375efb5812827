"""Accuracy and speed beside peers, growth, stage times, start-up, search.

    make bench                       everything, written into docs/benchmarks.md (12 minutes)
    python -m benchmarks --quick     a smoke run: the same code on little work, nothing written
    python -m benchmarks --only peers growth stages startup search

Needs PETS 2009 with its true camera (--data, $SCENE4D_DATA or ../shared/data) and the dependency
group "bench". Close other programs first: busy cores change every time, and some of the ratios.
"""

from dataclasses import dataclass
from pathlib import Path

from benchmarks import (
    comparison,
    figures,
    growth,
    options_of,
    peers,
    scenes,
    search,
    stages,
    startup,
)
from benchmarks.tables import Rows, machine, markdown, put
from scene4d.evaluation import pets

SECTIONS = ("peers", "growth", "stages", "startup", "search")
NEED_DATA = {"peers", "growth", "stages"}


@dataclass(frozen=True)
class Amount:
    """How much work each measurement gets."""

    seeds: int
    iterations: int
    people: tuple[int, ...]
    frames: tuple[int, ...]
    widths: tuple[int, ...]
    pictures: int
    crowd: tuple[int, ...]
    sampled: int | None
    starts: int
    days: tuple[int, ...]
    searches: int


FULL = Amount(
    seeds=12,
    iterations=peers.ITERATIONS,
    people=(100, 1_000, 10_000, 100_000, 1_000_000),
    frames=(10, 40, 100, 400),
    widths=(384, 768, 1152, 1536, 1920, 2880, 3840),
    pictures=4,
    crowd=(100, 1_000, 10_000, 100_000),
    sampled=None,
    starts=9,
    days=(10_000, 100_000, 1_000_000),
    searches=5,
)
QUICK = Amount(
    seeds=2,
    iterations=300,
    people=(100, 1_000, 10_000),
    frames=(5, 10),
    widths=(384, 1536),
    pictures=1,
    crowd=(100, 1_000),
    sampled=20,
    starts=2,
    days=(5_000, 20_000),
    searches=1,
)


class Report:
    """Prints every table, and with ``write`` puts tables and pictures into the page."""

    def __init__(self, write: bool) -> None:
        self.write = write

    def table(self, name: str, rows: Rows) -> None:
        text = markdown(rows)
        print(f"\n{name}\n{text}", flush=True)
        if self.write:
            put(name, text)

    def curves(self, name: str, measured: tuple[Rows, list[growth.Curve]]) -> None:
        self.table(f"growth of {name}", measured[0])
        if self.write:
            figures.growth(name, measured[1])


def measure(report: Report, amount: Amount, wanted: list[str], data: Path) -> None:
    video = data / "vtest.avi"
    if "startup" in wanted:
        report.table("start-up", startup.table(amount.starts))
    if "peers" in wanted or "stages" in wanted:
        timed = stages.timed_calibration(video, amount.sampled)
        if "stages" in wanted:
            report.table("stages", stages.table(timed, video, amount.sampled))
        if "peers" in wanted:
            case = scenes.recorded(timed.result.calibration, pets(data))
            compare(report, amount, case)
    if "growth" in wanted:
        report.curves("people", growth.people(amount.people))
        report.curves("frames", growth.frames(video, amount.frames))
        report.curves("sizes", growth.sizes(video, amount.widths, amount.pictures))
        report.curves("pairs", growth.pairs(amount.crowd))
    if "search" in wanted:
        with search.days(amount.days) as days:
            report.table("search", search.table(days[-1], amount.searches))
            report.curves("search", search.growth(days, amount.searches))
        report.table("a month", search.month(amount.days[-1]))


def compare(report: Report, amount: Amount, case: scenes.Scene) -> None:
    methods = [*peers.own_methods(), *peers.cameratransform_methods(amount.iterations)]
    attempts: list[comparison.Attempt] = []
    for drawn in (0.0, 0.1, 0.3):
        attempts += comparison.compare(methods, scenes.synthetic(amount.seeds, drawn))
    attempts += comparison.compare(methods, [case])
    report.table("peers", comparison.table(attempts))
    if report.write:
        figures.peers(attempts)


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS)
    parser.add_argument("--quick", action="store_true", help="little work, nothing to be written")
    parser.add_argument("--write", action="store_true", help="put the results into the page")
    asked = parser.parse_args()
    if asked.quick and asked.write:
        parser.error("--quick measures too little to be written into the page")
    folder = asked.data / "pets2009"
    if NEED_DATA & set(asked.only) and not folder.is_dir():
        parser.error(f"{folder}: is not there; --data names the folder that holds pets2009/")
    print(machine())
    if asked.write:
        put("machine", machine())
    measure(Report(asked.write), QUICK if asked.quick else FULL, list(asked.only), folder)


if __name__ == "__main__":
    main()
