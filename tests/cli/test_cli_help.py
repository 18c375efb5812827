"""What people read before they run anything, and what that costs."""

import inspect
import itertools
import re
import resource
import shlex
import subprocess
import sys

import pytest
import typer

from scene4d.calibration import METHODS
from scene4d.cli.app import app
from scene4d.cli.calibrate import Method
from scene4d.formats.cameras import camera_formats

HEAVY = ("numpy", "cv2", "av", "onnxruntime", "matplotlib", "scipy", "supervision", "arro3")
PROMISED = {
    "calibrate": (
        "--out --lens --annotations --image-size --person-height --method --orientation "
        "--estimate-focal --frames --seed --drop-invalid --json"
    ),
    "export": "--to --out --json",
    "models": "--json",
    "demo": "--out --json",
}


def options_of(command: str) -> set[str]:
    parameters = typer.main.get_command(app).commands[command].params
    return {name for parameter in parameters for name in parameter.opts}


@pytest.mark.parametrize("command", PROMISED)
def test_every_promised_option_is_there_and_explained(run, command):
    result = run(command, "--help")
    assert result.exit_code == 0, result.stderr
    assert result.stderr == ""
    assert set(PROMISED[command].split()) <= options_of(command)
    shown = set(re.findall(r"--[a-z-]+", result.stdout))
    assert set(PROMISED[command].split()) <= shown
    assert "Example" in result.stdout


def test_there_are_no_other_commands():
    assert set(typer.main.get_command(app).commands) == set(PROMISED)


@pytest.mark.parametrize("command", PROMISED)
def test_the_examples_name_what_exists(command):
    text = inspect.cleandoc(typer.main.get_command(app).commands[command].help)
    joined = re.sub(r"\\\n\s*", "", text)
    examples = re.findall(r"^\s+(?:\w+=\S+ )?(scene4d .*)$", joined, re.MULTILINE)
    assert len(examples) >= 2
    for example in examples:
        program, named, *rest = shlex.split(example)
        assert (program, named) == ("scene4d", command)
        assert {word for word in rest if word.startswith("--")} <= options_of(named), example


def test_paragraphs_wrap_at_the_width_of_the_terminal(spawn):
    narrow = spawn(["calibrate", "--help"], env={"COLUMNS": "60"}).stdout
    text = narrow[: narrow.index("Examples")]
    lines = [line.rstrip() for line in text.splitlines()]
    assert max(map(len, lines)) <= 60
    inner = [a for a, b in itertools.pairwise(lines) if a and b]
    assert min(map(len, inner)) > 40, "a paragraph is broken in the middle"


def test_export_names_every_format_that_is_written(run):
    text = " ".join(re.sub("[│╭╮╰╯─]", " ", run("export", "--help").stdout).split())
    for known in camera_formats():
        assert (re.search(rf"\b{known.name}\b", text) is not None) == (known.write is not None)


def test_the_methods_are_those_of_the_solver():
    assert tuple(Method) == METHODS


def test_version(run):
    result = run("--version")
    assert result.exit_code == 0
    assert re.fullmatch(r"scene4d \d+\.\d+\.\d+\S*\n", result.stdout)


@pytest.mark.parametrize("arguments", [[], ["--help"], ["calibrate", "--help"], ["--version"]])
def test_help_loads_nothing_heavy(arguments):
    program = (
        "import sys\n"
        "from scene4d.cli.app import app\n"
        f"try: app({arguments})\n"
        "except SystemExit: pass\n"
        f"print([m for m in {HEAVY} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stderr.splitlines()[-1] == "[]"


def test_help_takes_less_than_a_third_of_a_second(spawn):
    """In processor time, which other programs on the machine do not disturb; the best of three."""
    taken = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert spawn(["--help"]).returncode == 0
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(taken) < 0.3, taken
