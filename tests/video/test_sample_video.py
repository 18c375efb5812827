"""The sample video: sources in order, every copy checked, nothing half-written."""

import gzip
import hashlib
import io
import subprocess
import tarfile
from pathlib import Path

import pytest

from scene4d.core.errors import OutputError, UnavailableError
from scene4d.video import sample
from scene4d.video.sample import SampleSource, sample_video, video_from_deb

CONTENT = b"RIFF the sample video" * 50


@pytest.fixture(autouse=True)
def small_sample(monkeypatch):
    monkeypatch.setattr(sample, "SHA256", hashlib.sha256(CONTENT).hexdigest())


def gives(name: str, content: bytes, asked: list[str]) -> SampleSource:
    return SampleSource(name, lambda: asked.append(name) or content)


def fails(name: str, error: Exception, asked: list[str]) -> SampleSource:
    def fetch() -> bytes:
        asked.append(name)
        raise error

    return SampleSource(name, fetch)


def test_the_pinned_hash_is_that_of_the_real_file(shared_data, monkeypatch):
    monkeypatch.undo()
    sums = (shared_data / "pets2009" / "SHA256SUMS").read_text().split()
    assert sums == [sample.SHA256, "pets2009/vtest.avi"]
    data = (shared_data / "pets2009" / "vtest.avi").read_bytes()
    assert hashlib.sha256(data).hexdigest() == sample.SHA256


def test_the_order_is_cache_debian_opencv():
    assert [s.fetch for s in sample.SOURCES] == [sample.from_debian, sample.from_opencv]


def test_the_first_source_that_has_it_wins_and_the_cache_is_used_next(tmp_path):
    asked, told = [], []
    sources = [
        fails("one", OSError("no route"), asked),
        gives("two", CONTENT, asked),
        gives("three", CONTENT, asked),
    ]
    cache = tmp_path / "deep" / "cache"
    path = sample_video(cache, progress=told.append, sources=sources)
    assert path == cache / "vtest.avi"
    assert path.read_bytes() == CONTENT
    assert asked == ["one", "two"]
    assert told == ["sample video: trying one", "sample video: trying two"]
    assert sample_video(cache, sources=sources) == path
    assert asked == ["one", "two"]
    assert [p.name for p in cache.iterdir()] == ["vtest.avi"]


def test_another_file_is_never_accepted_and_never_left(tmp_path):
    asked = []
    (tmp_path / "vtest.avi").write_bytes(b"damaged")
    sources = [gives("bad", b"other", asked), gives("good", CONTENT, asked)]
    assert sample_video(tmp_path, sources=sources).read_bytes() == CONTENT
    assert asked == ["bad", "good"]


def test_when_nothing_is_reachable_every_failure_is_named(tmp_path):
    (tmp_path / "vtest.avi").write_bytes(b"damaged")
    failed = subprocess.CalledProcessError(100, ["apt-get"], stderr="W: x\nE: no such package\n")
    sources = [
        fails("Debian", failed, []),
        fails("OpenCV", TimeoutError("timed out"), []),
        gives("mirror", b"other", []),
    ]
    with pytest.raises(UnavailableError) as caught:
        sample_video(tmp_path, sources=sources)
    text = str(caught.value)
    for part in (
        f"cache: {tmp_path / 'vtest.avi'} has SHA-256",
        "Debian: apt-get failed: E: no such package",
        "OpenCV: timed out",
        f"mirror: the file has SHA-256 {hashlib.sha256(b'other').hexdigest()}",
        f"Put a copy with SHA-256 {sample.SHA256} at {tmp_path / 'vtest.avi'}",
    ):
        assert part in text
    assert (tmp_path / "vtest.avi").read_bytes() == b"damaged"


def test_a_defect_in_a_source_is_not_swallowed(tmp_path):
    with pytest.raises(ZeroDivisionError):
        sample_video(tmp_path, sources=[fails("broken", ZeroDivisionError(), [])])


def test_a_cache_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        sample_video(tmp_path / "file" / "cache", sources=[gives("one", CONTENT, [])])


def deb(path: Path, member: str, content: bytes, suffix: str = ".xz") -> Path:
    """A minimal Debian package (deb(5)): an ar archive with a data.tar inside."""
    tar = io.BytesIO()
    with tarfile.open(fileobj=tar, mode=f"w:{suffix[1:]}") as archive:
        for name, data in (("./usr/share/doc/x/README", b"odd"), (member, content)):
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    parts = [("debian-binary", b"2.0\n"), ("control.tar", b"odd"), (f"data.tar{suffix}", None)]
    with path.open("wb") as out:
        out.write(b"!<arch>\n")
        for name, data in parts:
            data = tar.getvalue() if data is None else data
            out.write(f"{name:<16}{0:<12}{0:<6}{0:<6}{100644:<8}{len(data):<10}`\n".encode())
            out.write(data + b"\n" * (len(data) % 2))
    return path


FOLDER = "./usr/share/doc/opencv-doc/examples/data/"


@pytest.mark.parametrize("suffix", [".xz", ".gz"])
@pytest.mark.parametrize("packed", [False, True])
def test_the_video_is_taken_out_of_the_package(tmp_path, suffix, packed):
    name = FOLDER + ("vtest.avi.gz" if packed else "vtest.avi")
    content = gzip.compress(CONTENT) if packed else CONTENT
    assert video_from_deb(deb(tmp_path / "a.deb", name, content, suffix)) == CONTENT


def test_packages_without_the_video_and_downloads_that_are_no_package(tmp_path):
    with pytest.raises(LookupError, match=r"no vtest\.avi"):
        video_from_deb(deb(tmp_path / "a.deb", FOLDER + "other.avi", b"x"))
    page = tmp_path / "b.deb"
    page.write_text("<html>log in first</html>")
    with pytest.raises(ValueError, match="no Debian package"):
        video_from_deb(page)
    whole = deb(tmp_path / "c.deb", FOLDER + "vtest.avi", CONTENT).read_bytes()
    for length in (30, 100, len(whole) // 2):
        page.write_bytes(whole[:length])
        with pytest.raises(sample.FAILURES):
            video_from_deb(page)


def test_missing_package_lists_are_fetched_privately(monkeypatch):
    calls = []

    def run(command: list[str], folder: Path) -> None:
        calls.append(command)
        private = [c for c in command if c.startswith("Dir::")]
        assert all(Path(c.split("=")[1]).is_relative_to(folder) for c in private)
        if command[1] == "download":
            raise subprocess.CalledProcessError(100, command, stderr="E: Unable to locate package")
        if command[-1] == "download" or command[-2] == "download":
            deb(folder / "opencv-doc_4_all.deb", FOLDER + "vtest.avi", CONTENT)

    monkeypatch.setattr(sample, "_run", run)
    monkeypatch.setattr(sample.shutil, "which", lambda name: f"/usr/bin/{name}")
    assert sample.from_debian() == CONTENT
    assert [[c for c in call if "=" not in c and c != "-o"][1:] for call in calls] == [
        ["download", "opencv-doc"],
        ["update"],
        ["download", "opencv-doc"],
    ]


def test_a_machine_without_apt_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(sample.shutil, "which", lambda name: None)
    debian = SampleSource("Debian", sample.from_debian)
    with pytest.raises(UnavailableError, match="Debian: apt-get is not installed"):
        sample_video(tmp_path, sources=[debian])
