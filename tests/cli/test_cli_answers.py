"""What every command answers to programs, and how much it tells people."""

import json
import logging
import warnings

import pytest
import typer
from typer.testing import CliRunner

from scene4d.cli.command import Answer, Job, command
from scene4d.cli.output import screen, visible
from scene4d.core.errors import InputError

HEAD = ["schema", "version", "warnings", "error"]
WRONG = {
    "usage": ["track", "--json"],
    "usage: an option that does not exist": ["models", "--jsn", "--json"],
    "usage: a value that cannot be": ["orientation", "a.mp4", "--frames", "x", "--json"],
    "input": ["calibrate", "nope.mp4", "--out", "o", "--json"],
    "input: track": ["track", "nope.mp4", "--camera", "nope.json", "--out", "o", "--json"],
    "input: export": ["export", "nope.json", "--to", "krtd", "--out", "x.krtd", "--json"],
    "input: orientation": ["orientation", "nope.jpg", "--json"],
    "input: evaluate": ["evaluate", "pets", "--data", "nope", "--json"],
    "usage: search": ["search", "nope", "person enters vehicle", "--json"],
}


@pytest.mark.parametrize("case", WRONG)
def test_a_failure_is_one_object_too(run, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    done = run(*WRONG[case])
    found = json.loads(done.stdout)
    assert list(found) == HEAD
    name = "evaluate pets" if WRONG[case][0] == "evaluate" else WRONG[case][0]
    assert found["schema"] == f"scene4d/{name}/1"
    kind = case.partition(":")[0]
    assert found["error"]["kind"] == kind
    assert done.exit_code == (2 if kind == "usage" else 1)
    assert found["error"]["message"] in " ".join(done.stderr.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [("models",), ("activities",)])
def test_a_result_has_the_same_head(run, arguments):
    found = json.loads(run(*arguments, "--json").stdout)
    assert list(found)[:4] == HEAD and len(found) > 4
    assert found["error"] is None and found["schema"] == f"scene4d/{arguments[0]}/1"


def program(work):
    app = typer.Typer()
    app.command()(command("try")(work))
    return lambda *arguments: CliRunner().invoke(app, list(arguments))


def told(job: Job) -> Answer:
    logging.getLogger("scene4d.video").warning("the footage is %s", "odd")
    logging.getLogger("scene4d.video").info("a detail")
    warnings.warn("a box is left out", UserWarning, stacklevel=1)
    return Answer({"n": 1, "schema": "mine"}, lambda: print("shown"), ("known before",))


def test_what_the_library_logs_reaches_people_and_programs():
    try_it = program(told)
    plain = try_it()
    assert plain.stdout == "shown\n"
    lines = plain.stderr.splitlines()
    assert lines == ["scene4d: warning: the footage is odd", "scene4d: warning: a box is left out"]
    found = json.loads(try_it("--json").stdout)
    assert found["warnings"] == ["the footage is odd", "a box is left out", "known before"]
    assert (found["n"], found["schema"]) == (1, "scene4d/try/1")


def test_quiet_tells_errors_alone_and_verbose_tells_all():
    assert program(told)("-q").stderr == ""
    assert "scene4d: a detail" in program(told)("--verbose").stderr

    def staged(job: Job) -> Answer:
        with job.progress() as progress, progress.stage("Working", None):
            return Answer({}, lambda: None)

    assert program(staged)().stderr == ""
    assert program(staged)("-v").stderr.startswith("scene4d: Working: 0.")

    def broken(job: Job) -> Answer:
        with job.progress() as progress, progress.stage("Working", None):
            raise InputError("x.json: field focal_px: found -1; give pixels")

    failed = program(broken)("-q")
    assert failed.stderr == "scene4d: error: x.json: field focal_px: found -1; give pixels\n"
    error = json.loads(program(broken)("--json").stdout)["error"]
    assert error["remedy"] == "give pixels"


def test_logging_is_as_it_was_when_a_command_has_ended():
    logger = logging.getLogger("scene4d")
    before = logger.level, logger.propagate, list(logger.handlers)
    program(told)("--verbose")
    assert (logger.level, logger.propagate, list(logger.handlers)) == before


@pytest.mark.parametrize("text", ["\x1b[2Jgone", "a\rb", "\x9b1m", "bell\x07"])
def test_what_comes_from_a_file_cannot_steer_the_terminal(capsys, text):
    with screen() as console:
        console.print(text)
        console.print(f"long {text}", soft_wrap=True)
    for shown in (capsys.readouterr().out, visible(text)):
        assert not any((ord(c) < 32 and c not in "\n\t") or 127 <= ord(c) < 160 for c in shown)
    assert "\\x" in visible(text)
