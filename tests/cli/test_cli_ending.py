"""How a command ends when something outside it goes wrong: signals, pipes, full disks, defects."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time

import pytest

from cli_scenes import PROGRAM

WAIT_S = 60


def read_until(fd: int, pattern: bytes) -> bytes:
    """What comes out of a terminal, until the pattern or the end is there."""
    seen, end = b"", time.monotonic() + WAIT_S
    while time.monotonic() < end and not re.search(pattern, seen):
        try:
            chunk = os.read(fd, 65536)
        except OSError:  # Linux says so when the other side has closed
            break
        if not chunk:
            break
        seen += chunk
    return seen


@pytest.mark.weights
def test_ctrl_c_while_people_are_watched(networks, pets, tmp_path):
    """On a terminal, in the middle of the bar: one line, 130, and nothing is left."""
    out = tmp_path / "new" / "out"
    screen, terminal = pty.openpty()
    command = [*PROGRAM, "calibrate", str(pets), "--out", str(out), "--json"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100", "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=terminal,
        env=environment,
        text=True,
        # A shell's background job ignores Ctrl-C, and its children would too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        os.close(terminal)
        seen = read_until(screen, rb"Watching people.*[1-9][0-9]*%")
        assert b"Watching people" in seen, seen
        process.send_signal(signal.SIGINT)
        seen += read_until(screen, rb"interrupted")
        stdout = process.communicate(timeout=WAIT_S)[0]
    os.close(screen)
    assert process.returncode == 130
    assert json.loads(stdout)["error"]["kind"] == "interrupted", "and nothing but this object"
    assert seen.count(b"scene4d: interrupted") == 1 and b"Traceback" not in seen
    assert seen.rindex(b"\x1b[?25h") > seen.rindex(b"\x1b[?25l"), "the cursor is back"
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_files_are_written(run, known, tmp_path, monkeypatch, plain_report):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("scene4d.core.tables.write_parquet", interrupted)
    out = tmp_path / "out"
    done = run(*known, "--out", out)
    assert done.exit_code == 130
    assert done.stdout == "" and done.stderr.splitlines()[-1] == "scene4d: interrupted"
    assert not out.exists()


@pytest.mark.parametrize("debug", ["", "1"])
def test_a_defect_asks_to_be_reported(run, known, tmp_path, monkeypatch, debug):
    def broken(*_: object, **__: object) -> None:
        raise KeyError("two\nlines")

    monkeypatch.setattr("scene4d.calibration.calibrating.run", broken)
    monkeypatch.setenv("SCENE4D_DEBUG", debug)
    done = run(*known, "--out", tmp_path / "out")
    assert done.exit_code == 1 and done.stdout == ""
    assert done.stderr.startswith("scene4d: internal error: KeyError: ")
    assert "report" in done.stderr or debug
    assert ("Traceback" in done.stderr) == bool(debug)
    assert len(done.stderr.splitlines()) == 2 or debug
    assert not (tmp_path / "out").exists()


def test_a_reader_who_goes_away_is_no_error():
    """``scene4d models | head -0``: the pipe is closed before anything is written."""
    with subprocess.Popen(
        [*PROGRAM, "models"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        process.stdout.close()
        process.stdout = None
        _, stderr = process.communicate(timeout=WAIT_S)
    assert (process.returncode, stderr) == (0, "")


def test_nobody_reads_the_messages_any_more(known, scene, tmp_path):
    """The work is finished where stderr is a pipe that was closed, and the code says how."""
    scene["boxes"].write_text("1,-1,600,300,60,200,1\n")
    out = tmp_path / "out"
    with subprocess.Popen(
        [*PROGRAM, *known, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stderr.close()
        process.stderr = None
        stdout, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 1 and b"report.html" in stdout
    assert (out / "camera.json").exists()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
def test_stdout_on_a_full_disk(spawn):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = spawn(["models", "--json"], stdout=full)
    assert done.returncode == 1
    assert done.stderr == (
        "scene4d: error: standard output cannot be written: No space left on device\n"
    )


def test_stdout_that_is_closed(tmp_path):
    done = subprocess.run(
        ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, *PROGRAM[1:], "models"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
def test_help_on_a_full_disk(spawn):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = spawn(["--help"], stdout=full)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert "standard output cannot be written" in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
@pytest.mark.parametrize("words", [["--version"], ["models"], ["models", "--json"]])
def test_a_full_disk_with_the_buffer_of_everyday(monkeypatch, spawn, words):
    """Python writes what is left in the buffer at the end: exit code 120, and a message of its own
    (R19); the version came with a traceback."""
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = spawn(words, stdout=full)
    expected = "scene4d: error: standard output cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (1, expected)


def test_ctrl_c_while_the_program_starts(tmp_path):
    """An import is interrupted: one line, not a traceback."""
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    done = subprocess.run(
        PROGRAM, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "scene4d: interrupted\n")


def test_sigterm_ends_as_ctrl_c_does(known, tmp_path):
    """What was staged is taken away, and the code says what happened."""
    slow = (
        "import os, signal\n"
        "import scene4d.core.tables as tables\n"
        "tables.write_parquet = lambda *_, **__: os.kill(os.getpid(), signal.SIGTERM)\n"
        "from scene4d.cli import main; main()"
    )
    out = tmp_path / "deep" / "out"
    command = [sys.executable, "-c", slow, *known, "--out", str(out), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=WAIT_S)
    assert done.returncode == 143, done.stderr
    assert done.stderr.splitlines()[-1] == "scene4d: terminated"
    assert json.loads(done.stdout)["error"]["kind"] == "terminated"
    assert not (tmp_path / "deep").exists()
