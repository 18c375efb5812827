"""``scene4d models``: what is listed and what is fetched; nothing here uses the network."""

import hashlib
import json
import re
from functools import partial

import pytest

from scene4d.core.fetching import Download, SourceFailedError
from scene4d.perception import weights as store

CONTENT = b"a network"


class Shelf:
    """A source with one file, or with none."""

    title = "shelf"

    def __init__(self, *contents: bytes) -> None:
        self.contents = contents

    def fetch(self, files, progress):
        if not self.contents:
            raise SourceFailedError("no network")
        progress(self.title, 4, 9)
        progress(self.title, 9, 9)
        return dict.fromkeys(files, self.contents[0])


@pytest.fixture
def weight(tmp_path, monkeypatch):
    """One weight, and an empty cache; returns how to say what its source has."""
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path / "cache"))

    def known(*contents: bytes) -> None:
        digest = hashlib.sha256(CONTENT).hexdigest()
        one = Download("net", "net.onnx", digest, 20_000_000, "MIT", (Shelf(*contents),))
        for function in ("weight_path", "fetch_all", "missing_weights", "list_weights"):
            given = partial(getattr(store, function), weights=(one,))
            monkeypatch.setattr(store, function, given)

    return known


def test_the_real_list(run, tmp_path, monkeypatch):
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path))
    found = json.loads(run("models", "--json").stdout)
    assert found["folder"] == str(tmp_path / "weights")
    names = [w.name for w in store.WEIGHTS]
    assert [w["name"] for w in found["weights"]] == [*names, "orientation"]
    for row in found["weights"]:
        assert set(row) == {
            "name", "file", "bytes", "present", "packaged", "verified", "licence",
        }  # fmt: skip
        assert row["present"] == row["verified"] == row["packaged"] == (row["name"] not in names)
    assert 0 < found["weights"][-1]["bytes"] < 25_000_000
    table = run("models").stdout
    assert table.count("packaged") == 1
    for row in found["weights"]:
        assert row["file"] in table and row["name"] in table
    assert "scene4d models fetch" in table


def test_fetch_gets_what_is_missing(run, weight, tmp_path):
    weight(CONTENT)
    done = run("models", "fetch", "--json")
    assert done.exit_code == 0, done.stderr
    row = json.loads(done.stdout)["weights"][0]
    assert row["present"] and row["verified"]
    assert (tmp_path / "cache" / "weights" / "net.onnx").read_bytes() == CONTENT
    again = run("models")
    assert "models fetch" not in again.stdout
    assert re.search(r"^net .* yes +yes ", again.stdout, re.MULTILINE)


def test_fetch_without_a_network_says_what_to_do(run, weight, tmp_path):
    weight()
    done = run("models", "fetch")
    assert done.exit_code == 1 and done.stdout == ""
    assert done.stderr.startswith("scene4d: error: net: ")
    for word in ("no network", "SHA-256", str(tmp_path / "cache" / "weights")):
        assert word in done.stderr


def test_a_damaged_file_is_seen(run, weight, tmp_path):
    weight(CONTENT)
    (tmp_path / "cache" / "weights").mkdir(parents=True)
    (tmp_path / "cache" / "weights" / "net.onnx").write_bytes(b"damaged")
    assert "damaged" in run("models").stdout
    row = json.loads(run("models", "--json").stdout)["weights"][0]
    assert row["present"] and not row["verified"]
    done = run("models", "fetch")
    assert done.exit_code == 1 and "delete it" in done.stderr
