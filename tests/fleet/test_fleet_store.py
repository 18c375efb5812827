"""Stores that are no folder: a server that speaks S3, on this machine."""

import json
import socket
import subprocess
import sys
import time
from urllib.error import URLError
from urllib.request import urlopen

import duckdb
import fsspec
import pytest
import s3fs
from fleet_plans import boxes, plan, results

from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.fleet import run_fleet
from scene4d.fleet._store import Store


@pytest.fixture
def s3(monkeypatch):
    """A bucket, and the process that serves it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    url = f"http://127.0.0.1:{port}"
    for name, value in {
        "AWS_ENDPOINT_URL": url,
        "AWS_ACCESS_KEY_ID": "nobody",
        "AWS_SECRET_ACCESS_KEY": "nothing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_MAX_ATTEMPTS": "1",
    }.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(s3fs.S3FileSystem, "retries", 1)  # for a server that is gone, seconds
    try:
        until_s = time.monotonic() + 60
        while not answers(f"{url}/moto-api/"):
            assert server.poll() is None and time.monotonic() < until_s
            time.sleep(0.1)
        files = fsspec.filesystem("s3", skip_instance_cache=True)
        files.mkdir("city")
        yield server, files
    finally:
        server.kill()
        server.wait()


def answers(url: str) -> bool:
    try:
        with urlopen(url, timeout=10):
            return True
    except (URLError, OSError):
        return False


def test_a_store_on_s3_holds_what_a_folder_holds(s3, tmp_path):
    server, files = s3
    folder = boxes(tmp_path, clips=1)
    asked = plan(folder, "search: {words: [a person walks]}")
    found = run_fleet(asked, "s3://city/october")
    assert found.to_dict()["done"] == 4 and found.quarantine == []
    assert run_fleet(asked, "s3://city/october").to_dict()["earlier"] == 4
    here = run_fleet(asked, folder / "store")
    assert found.events["a person walks"]["best"] == here.events["a person walks"]["best"]
    names = {name.removeprefix("city/october/") for name in files.find("city/october")}
    assert names >= set(results(folder / "store"))
    assert {"status.json", "events/0.parquet"} <= names

    with duckdb.connect() as connection:
        connection.register_filesystem(files)
        rows = (
            "SELECT camera, count(*) FROM read_parquet('{}/track/*/*/tracks/*/*/*.parquet') "
            "GROUP BY 1 ORDER BY 1"
        )
        there = connection.sql(rows.format("s3://city/october")).fetchall()
        assert there == connection.sql(rows.format(folder / "store")).fetchall() and len(there) == 2

    server.kill()
    server.wait()
    store = Store("s3://city/october")
    with pytest.raises(OutputError, match=r"s3://city/october/store\.json: cannot be written: "):
        store.open()
    with pytest.raises(InputError, match="s3://city/october/done: cannot be read: "):
        store.keys("done")


@pytest.mark.parametrize(
    ("address", "kind", "says"),
    [
        (
            "nothing://x/y",
            InputError,
            "nothing://x/y: is no store: .*; give a folder or an address",
        ),
        ("gs://x/y", UnavailableError, "gs://x/y: .*gcsfs.*; pip install the package"),
    ],
)
def test_what_is_no_store_is_refused(address, kind, says):
    with pytest.raises(kind, match=says):
        Store(address)


def test_a_folder_that_cannot_be_written_is_refused_at_once(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file: cannot be written"):
        Store(str(tmp_path / "file")).open()


def test_a_store_in_a_relative_folder_is_the_same_for_workers_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Store("store").address == str(tmp_path / "store")
    Store("store").write("done/a", {"path": "b"})
    assert json.loads((tmp_path / "store" / "done" / "a.json").read_text()) == {"path": "b"}
