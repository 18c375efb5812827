"""Shapes and types are checked at run time in every test (type_checks).

In continuous integration (the variable CI is set) a test that is skipped has failed: what was
meant to be checked was not.
"""

import gc
import os
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from benchmarks import DATA
from hypothesis import settings

import type_checks

# Each worker has a core; read by workers and by programs that are started, which load numpy later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
type_checks.install()

# A busy machine is no failure, and CI judges a change, not its luck: the same examples each time.
settings.register_profile("here", deadline=None)
# They are fewer than the hundred fresh ones that each run elsewhere draws: five minutes are few.
settings.register_profile("ci", deadline=None, derandomize=True, max_examples=50)

IN_CI = os.environ.get("CI", "").lower() not in {"", "0", "false"}
settings.load_profile("ci" if IN_CI else "here")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real recordings with known cameras; skipped with one sentence where they are absent."""
    if not DATA.is_dir():
        pytest.skip(f"the real recordings are not at {DATA}; set SCENE4D_DATA")
    return DATA


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever asks for the recordings can be left out by ``-m "not shared_data"``."""
    for item in items:
        if "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker("shared_data")


def pytest_collection_finish() -> None:
    """What is imported by now stays: the garbage collector need not look through it all again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)


def pytest_unconfigure() -> None:
    """Libraries that count what is left at the end find nothing."""
    gc.unfreeze()


def pytest_configure(config: pytest.Config) -> None:
    """Keep compiled code where Python is told to write none beside its sources: tests start the
    program some fifty times, and each time it would compile a thousand modules.
    """
    if sys.dont_write_bytecode and hasattr(config, "cache"):
        sys.pycache_prefix = str(config.cache.mkdir("bytecode"))
        sys.dont_write_bytecode = False
        os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def _fail_a_skip(report):
    if IN_CI and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        *_, reason = report.longrepr
        report.longrepr = f"{reason}\nIn CI a skipped test is a failure."
    return report


def pytest_runtest_setup() -> None:
    type_checks.begin()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    return _fail_a_skip((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    return _fail_a_skip((yield))
