"""Kill a fleet where it hurts: python scripts/fleet_faults.py [--kills 20] [--seed 0]

A real Ray cluster of several nodes on this machine works through 40 small clips again and again,
while workers and nodes are killed (SIGKILL) at random moments; then the head of the cluster, and
the program itself, which are started again; then files may only grow so far, as on a full disk.
Each time the store must at the end hold what an undisturbed run in one process writes. Exit status
1 with the first thing that is not so. On two cores 20 kills take about five minutes.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / name) for name in ("tests/fleet", "tests", "src")]

from fleet_plans import NODE, boxes, head, left_half, plan, results, tiny_work  # noqa: E402

from scene4d.fleet import read_plan, run_fleet  # noqa: E402

CLIPS = 20
CHILD = """
import sys
from fleet_plans import tiny_work
from scene4d.fleet import run_fleet
run_fleet(sys.argv[1], sys.argv[2], ray=sys.argv[3] or None, work=tiny_work)
"""


class Nodes:
    """A head without work, and two nodes with a core each."""

    def __init__(self) -> None:
        self.cluster = head(0)
        self.nodes: list = []
        self.filled()

    def filled(self) -> None:
        """Others come in the place of nodes that died; Ray wants that in the main thread."""
        while len(self.nodes) < 2:
            self.nodes.append(self.cluster.add_node(**NODE))

    def kill_node(self, rng: random.Random) -> bool:
        """One dies, if it is not the last."""
        if len(self.nodes) < 2:
            return False
        dead = self.nodes.pop(rng.randrange(len(self.nodes)))
        self.cluster.remove_node(dead, allow_graceful=False)
        return True


def check(fact: bool, what: str) -> None:
    if not fact:
        raise SystemExit(f"fleet_faults: {what}")


def done(store: Path) -> int:
    return len(list((store / "done").glob("*.json")))


def kill_worker(folder: Path) -> bool:
    """Kill the worker that began a clip last, if it is at work."""
    begun = sorted((folder / "workers").glob("*.*"), key=lambda one: one.stat().st_mtime_ns)
    try:
        os.kill(int(begun[-1].suffix[1:]), signal.SIGKILL)
    except (IndexError, ProcessLookupError):
        return False
    return True


def equal(folder: Path, store: Path, what: str) -> None:
    check(results(store) == results(folder / "quiet"), f"{what}: the store is not as undisturbed")
    check(not list((store / "quarantine").glob("*")), f"{what}: a good clip is in quarantine")
    check(not left_half(store), f"{what}: half a result was left")


def kill_workers_and_nodes(
    there: Nodes, folder: Path, path: Path, kills: int, rng: random.Random
) -> str:
    killed, round_ = {"worker": 0, "node": 0}, 0
    while sum(killed.values()) < kills:
        shutil.rmtree(folder / "workers", ignore_errors=True)
        there.filled()
        store, round_ = folder / f"killed{round_}", round_ + 1
        ended = threading.Event()

        def kill(ended: threading.Event = ended) -> None:
            while not ended.wait(rng.uniform(0.2, 3.0)) and sum(killed.values()) < kills:
                if rng.random() < 0.3:
                    killed["node"] += there.kill_node(rng)
                else:
                    killed["worker"] += kill_worker(folder)

        thread = threading.Thread(target=kill)
        thread.start()
        run_fleet(read_plan(path), store, ray=there.cluster.address, work=tiny_work)
        ended.set()
        thread.join()
        equal(folder, store, "kills")
    return f"{killed['worker']} workers and {killed['node']} nodes in {round_} runs"


def kill_head_and_program(there: Nodes, folder: Path, path: Path, rng: random.Random) -> str:
    """The cluster outlives the program; where its head is killed, there is another one."""
    told = []
    for number, what in enumerate(("program", "program", "program alone", "head")):
        there.filled()
        store = folder / f"restarted{number}"
        words = [path, store, "" if what == "program alone" else there.cluster.address]
        process = subprocess.Popen(
            [sys.executable, "-c", CHILD, *map(str, words)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        until = time.monotonic() + 120
        least = rng.randint(2, 20)
        while done(store) < least and time.monotonic() < until:
            time.sleep(0.05)
        check(process.poll() is None, f"{what}: ended before it was killed")
        if what == "head":
            there.cluster.head_node.kill_gcs_server()
            there.cluster.head_node.kill_raylet()
        else:
            process.kill()
        process.wait(timeout=300)
        check(process.returncode != 0, f"{what}: the fleet did not notice")
        kept = done(store)
        check(least <= kept < 2 * CLIPS, f"{what}: {kept} results")
        if what == "head":
            there.cluster.shutdown()
            there = Nodes()
        found = run_fleet(read_plan(path), store, ray=there.cluster.address, work=tiny_work)
        check(found.to_dict()["earlier"] >= kept, f"{what}: results were lost")
        equal(folder, store, what)
        told.append(f"{what} after {kept}")
        print(f"killed: {told[-1]}", flush=True)
    there.cluster.shutdown()
    return ", ".join(told)


def fill_disk(folder: Path, path: Path) -> str:
    store, sizes = folder / "full", (100, 2_000, 20_000)
    for size in sizes:

        def limited(size: int = size) -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

        words = [sys.executable, "-m", "scene4d", "fleet", path, "--out", store, "--json"]
        ended = subprocess.run(
            [*map(str, words)], capture_output=True, text=True, check=False, preexec_fn=limited
        )
        said = json.loads(ended.stdout)
        check(ended.returncode == 1, f"full disk: {size} bytes: ended with {ended.returncode}")
        check(said["error"]["kind"] == "output", f"full disk: {said['error']}")
        check(not (store / "quarantine").exists(), "full disk: a clip is to blame")
    run_fleet(path, store)
    run_fleet(path, folder / "room")
    tables = [set(results(one)) for one in (store, folder / "room")]
    check(tables[0] == tables[1] and len(tables[0]) > 0, "full disk: other results afterwards")
    return f"{len(sizes)} full disks"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, begun_s = random.Random(given.seed), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fleet-faults-") as name:
        folder = boxes(Path(name), clips=CLIPS)
        path = plan(folder, "workers: {cores: 1, memory_gb: 1, attempts: 50}")
        run_fleet(path, folder / "quiet", work=tiny_work)
        there = Nodes()
        killed = kill_workers_and_nodes(there, folder, path, given.kills, rng)
        print(f"killed: {killed}", flush=True)
        restarted = kill_head_and_program(there, folder, path, rng)
    with tempfile.TemporaryDirectory(prefix="fleet-faults-") as name:
        folder = boxes(Path(name), clips=1)
        full = fill_disk(folder, plan(folder))
    print(
        f"fleet_faults: killed {killed}; {restarted} of {2 * CLIPS} clips; {full}: each time the "
        f"store of an undisturbed run, no clip done twice (seed {given.seed}, "
        f"{time.monotonic() - begun_s:.0f} s)"
    )


if __name__ == "__main__":
    main()
