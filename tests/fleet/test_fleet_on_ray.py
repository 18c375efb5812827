"""A real cluster of several nodes on this machine: whatever is killed, nothing is lost."""

import os
import random
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from fleet_plans import NODE, boxes, head, left_half, plan, results, tiny_work

from scene4d.core.errors import UnavailableError
from scene4d.fleet import read_plan, run_fleet
from scene4d.fleet._executors import OnRay
from scene4d.fleet._plan import Workers


@pytest.fixture(scope="module")
def cluster():
    """A head, and a node that may be killed; a core each."""
    made = head(1)
    made.victim = made.add_node(**NODE)
    yield made
    made.shutdown()


def killer(cluster, folder: Path, store: Path, rng: random.Random) -> None:
    """Kills a worker that is at work, and later a node, at random moments."""
    seen = folder / "workers"
    until(lambda: seen.is_dir() and any(seen.iterdir()))
    time.sleep(rng.uniform(0.0, 0.3))
    newest = max(seen.iterdir(), key=lambda one: one.stat().st_mtime_ns)
    os.kill(int(newest.suffix[1:]), signal.SIGKILL)
    until(lambda: len(list((store / "done").glob("*.json"))) >= rng.randint(3, 6))
    time.sleep(rng.uniform(0.0, 0.3))
    cluster.remove_node(cluster.victim, allow_graceful=False)


def until(there) -> None:
    end_s = time.monotonic() + 60
    while not there() and time.monotonic() < end_s:
        time.sleep(0.02)


def test_a_killed_worker_and_a_killed_node_lose_nothing(cluster, tmp_path, capfd, monkeypatch):
    from ray._common.usage import usage_lib

    folder = boxes(tmp_path, clips=7)
    (folder / "gate" / "gate-20261120T080300.txt").write_text("poison")
    asked = read_plan(plan(folder, "workers: {cores: 1, memory_gb: 1}"))
    store = folder / "store"
    thread = threading.Thread(target=killer, args=(cluster, folder, store, random.Random()))
    thread.start()
    found = run_fleet(asked, store, ray=cluster.address, work=tiny_work)
    thread.join()
    assert capfd.readouterr().out == ""  # where --json is
    said = found.to_dict()
    assert (said["done"], said["quarantined"]) == (13, 1)
    (aside,) = found.quarantine
    assert aside["clip"].endswith("080300.txt")
    assert aside["reason"].startswith("it killed 3 workers")
    # It is not tried again here, where it would kill this process.
    (folder / "quiet" / "quarantine").mkdir(parents=True)
    name = f"{aside['key']}.json"
    (folder / "quiet" / "quarantine" / name).write_bytes((store / "quarantine" / name).read_bytes())
    run_fleet(asked, folder / "quiet", work=tiny_work)
    assert results(store) == results(folder / "quiet")
    assert len({path.suffix for path in (folder / "workers").iterdir()}) > 3
    assert not left_half(store)

    # Ray's report of its use is off, whatever it was before.
    monkeypatch.delenv("RAY_USAGE_STATS_ENABLED")
    with pytest.raises(UnavailableError, match="no machine has 64 cores and 1 GB; ask for less"):
        OnRay(str(store), cluster.address, Workers(64.0, 1.0), tiny_work)
    assert not usage_lib.usage_stats_enabled()


def test_without_ray_or_a_cluster_there_is_one_error(monkeypatch):
    monkeypatch.delenv("RAY_USAGE_STATS_ENABLED", raising=False)
    with pytest.raises(UnavailableError, match=r"127\.0\.0\.1:1: no Ray cluster answers"):
        OnRay("x", "127.0.0.1:1", Workers(), tiny_work)
    assert os.environ["RAY_USAGE_STATS_ENABLED"] == "0"  # before Ray is imported, which reads it
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UnavailableError, match=r"Ray is not here; pip install 'scene4d\[ray\]'"):
        OnRay("x", "local", Workers(), tiny_work)
