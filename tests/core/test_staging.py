"""Results of several files: all of them or none, and never less than there was before."""

import errno
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from scene4d.core.errors import OutputError
from scene4d.core.staging import ensure_folder, staged

NAMES, LAST = ["figures/a.png", "figures/b.png", "report.html"], "camera.json"


def write(out: Path, text: str, names=(*NAMES, LAST)) -> None:
    with staged(out, NAMES, LAST) as folder:
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)


def content(out: Path) -> dict[str, str]:
    return {
        str(path.relative_to(out)): path.read_text()
        for path in sorted(out.rglob("*"))
        if path.is_file()
    }


def whole(text: str) -> dict[str, str]:
    return dict.fromkeys(sorted([*NAMES, LAST]), text)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    write(tmp_path, "old")
    return tmp_path


def test_all_files_are_replaced_and_nothing_else_is_left(out):
    (out / "mine.txt").write_text("mine")
    write(out, "new")
    assert content(out) == whole("new") | {"mine.txt": "mine"}
    assert sorted(path.name for path in out.iterdir()) == [
        "camera.json", "figures", "mine.txt", "report.html",
    ]  # fmt: skip


def test_what_is_not_written_this_time_goes(out):
    write(out, "new", ["report.html", LAST])
    assert content(out) == {LAST: "new", "report.html": "new"}


def test_a_failure_while_writing_changes_nothing(out):
    with pytest.raises(KeyboardInterrupt), staged(out, NAMES, LAST) as folder:
        (folder / LAST).write_text("new")
        raise KeyboardInterrupt
    with pytest.raises(OutputError) as caught, staged(out, NAMES, LAST) as folder:
        raise OutputError(f"{folder}/report.html: cannot be written: No space left on device")
    assert str(caught.value).startswith(f"{out}/report.html: cannot be written: No space")
    assert content(out) == whole("old")


def test_a_file_in_the_place_of_a_folder_is_found_before_anything_moves(out):
    """R2: rm -r o/figures; touch o/figures; calibrate again: camera.json was gone."""
    for path in (out / "figures").iterdir():
        path.unlink()
    (out / "figures").rmdir()
    (out / "figures").write_text("in the way")
    with pytest.raises(OutputError, match=r"figures.a\.png: cannot be written: (File exists|Not)"):
        write(out, "new")
    assert content(out) == {LAST: "old", "report.html": "old", "figures": "in the way"}


def test_a_folder_in_the_place_of_a_file_is_found_before_anything_moves(out):
    (out / "report.html").unlink()
    (out / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html: cannot be written: is a folder"):
        write(out, "new")
    assert content(out) == {name: "old" for name in whole("") if name != "report.html"}


def test_a_read_only_folder_is_found_before_anything_moves(out, monkeypatch):
    """By what the system says of it: permissions do not bind root, who may run this."""
    monkeypatch.setattr("os.access", lambda path, mode: Path(path).name != "figures")
    with pytest.raises(OutputError, match=r"figures.a\.png: cannot be written: .*read-only"):
        write(out, "new")
    assert content(out) == whole("old")


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("step", [0, 1, 2, 3])
@pytest.mark.parametrize(
    "failure", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")]
)
@pytest.mark.parametrize("before", ["old", None])
def test_a_failure_while_moving_moves_all_back(tmp_path, monkeypatch, failure, step, links, before):
    if before:
        write(tmp_path, before)
    replace, moves = Path.replace, []

    def fail(self, target):
        moves.append(target)
        if len(moves) == step + 1:
            raise failure
        return replace(self, target)

    def no_links(self, target):
        raise OSError(errno.EPERM, "Operation not permitted")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail)
        if not links:
            patch.setattr(Path, "hardlink_to", no_links)
        with pytest.raises((KeyboardInterrupt, OutputError)):
            write(tmp_path, "new")
    assert content(tmp_path) == (whole(before) if before else {})


def test_the_last_file_is_replaced_last_and_is_there_all_the_while(out, monkeypatch):
    replace, seen = Path.replace, []

    def look(self, target):
        seen.append((Path(target).name, (out / LAST).read_text()))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", look)
    write(out, "new")
    assert [name for name, _ in seen] == ["a.png", "b.png", "report.html", LAST]
    assert {text for _, text in seen} == {"old"}


def test_an_output_folder_is_made_and_tried(tmp_path):
    folder = ensure_folder(tmp_path / "a" / "b")
    assert folder.is_dir() and not list(folder.iterdir())
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file: cannot be written: File exists"):
        ensure_folder(tmp_path / "file")


def test_many_may_try_a_folder_at_once(tmp_path):
    with ThreadPoolExecutor(8) as threads:
        assert {*threads.map(ensure_folder, [tmp_path / "a"] * 400)} == {tmp_path / "a"}


def test_what_a_killed_process_left_is_removed_and_a_living_ones_is_not(out):
    code = (
        "import sys, pathlib, time; from scene4d.core.staging import staged\n"
        "with staged(pathlib.Path(sys.argv[1]), ['report.html'], 'camera.json') as folder:\n"
        "    (folder / 'report.html').touch(); print(folder, flush=True); time.sleep(60)"
    )
    words = [sys.executable, "-c", code, str(out)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as living:
        staging = Path(living.stdout.readline().strip())
        with staged(out, NAMES, LAST) as own:
            write(out, "new")
            assert (staging / "report.html").exists() and own.exists()
            (own / LAST).write_text("newer")
        living.kill()
    assert staging.exists()
    write(out, "new")
    assert not list(out.glob(".*"))


def test_where_nothing_can_be_locked_results_are_written_and_nobodys_are_removed(out, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", no_locks)
    with staged(out, NAMES, LAST) as own:
        write(out, "new")
        assert own.exists()
        (own / LAST).write_text("newer")
    assert (out / LAST).read_text() == "newer"
    assert not list(out.glob(".*"))
