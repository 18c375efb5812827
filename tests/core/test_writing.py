"""Files are whole or not there: what is written atomically, and what a failure leaves."""

import errno
import os
import stat

import pytest

from scene4d.core.errors import OutputError
from scene4d.core.files import write_bytes, write_json


def names(folder):
    return sorted(p.name for p in folder.iterdir())


@pytest.fixture
def old_file(tmp_path):
    path = tmp_path / "result.bin"
    path.write_bytes(b"old")
    return path


def test_a_file_is_written_and_nothing_beside_it(tmp_path):
    write_bytes(tmp_path / "new.bin", b"\x00\xffcontent")
    write_bytes(str(tmp_path / "empty.bin"), b"")
    assert names(tmp_path) == ["empty.bin", "new.bin"]
    assert (tmp_path / "new.bin").read_bytes() == b"\x00\xffcontent"
    assert (tmp_path / "empty.bin").read_bytes() == b""


def test_a_file_is_replaced_not_appended(old_file):
    write_bytes(old_file, b"n")
    assert old_file.read_bytes() == b"n"
    assert names(old_file.parent) == ["result.bin"]


def test_a_file_gets_the_usual_permissions(tmp_path):
    umask = os.umask(0o027)
    try:
        write_bytes(tmp_path / "a", b"")
        now = os.umask(0o027)
    finally:
        os.umask(umask)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640
    assert now == 0o027


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize(
    ("failure", "seen"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), OutputError),
        (OSError(errno.EROFS, "Read-only file system"), OutputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
    ids=["full", "read-only", "ctrl-c"],
)
def test_a_failure_keeps_the_old_file_and_leaves_nothing(
    monkeypatch, old_file, step, failure, seen
):
    def fail(*_args, **_options):
        raise failure

    target = "os.fsync" if step == "fsync" else f"pathlib.Path.{step}"
    with monkeypatch.context() as patch:
        patch.setattr(target, fail)
        with pytest.raises(seen) as caught:
            write_bytes(old_file, b"new content")
    if seen is OutputError:
        assert str(caught.value) == f"{old_file}: cannot be written: {failure.strerror}"
    assert old_file.read_bytes() == b"old"
    assert names(old_file.parent) == ["result.bin"]


def test_the_old_file_stands_until_the_new_one_is_whole(monkeypatch, old_file):
    seen = {}
    sync = os.fsync

    def look(handle):
        seen["target"] = old_file.read_bytes()
        seen["files"] = names(old_file.parent)
        sync(handle)

    monkeypatch.setattr("os.fsync", look)
    write_bytes(old_file, b"new")
    assert seen["target"] == b"old"
    # Beside the target, hidden, so that moving it is one step on the same file system.
    beside = [n for n in seen["files"] if n != "result.bin"]
    assert len(beside) == 1
    assert beside[0].startswith(".result.bin.")
    assert old_file.read_bytes() == b"new"


def test_where_nothing_can_be_written_the_path_is_named(tmp_path):
    (tmp_path / "file").write_text("a file, not a folder")
    (tmp_path / "folder").mkdir()
    for path, reason in (
        (tmp_path / "missing" / "out.json", "No such file or directory"),
        (tmp_path / "file" / "out.json", "Not a directory"),
        (tmp_path / "folder", "Is a directory"),
    ):
        with pytest.raises(OutputError) as caught:
            write_bytes(path, b"content")
        assert str(caught.value) == f"{path}: cannot be written: {reason}"
    assert names(tmp_path) == ["file", "folder"]
    assert names(tmp_path / "folder") == []


def test_json_is_plain_text_that_ends_with_a_line(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"b": [1, 2.5], "a": "°"})
    text = path.read_text(encoding="utf-8")
    assert text.endswith("}\n")
    assert text.index('"b"') < text.index('"a"')


@pytest.mark.parametrize("bad", [{"x": float("nan")}, {"x": float("inf")}, {"x": object()}])
def test_values_that_are_no_json_touch_nothing(tmp_path, bad):
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises((ValueError, TypeError)):
        write_json(path, bad)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.json"]
