"""What people read before they run anything, and what that costs."""

import inspect
import itertools
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
import typer
import yaml

from scene4d.calibration import METHODS
from scene4d.cli.app import app
from scene4d.cli.calibrate import Method
from scene4d.formats.cameras import camera_formats
from scene4d.formats.scenes import scene_formats

HEAVY = ("numpy", "cv2", "av", "onnxruntime", "matplotlib", "scipy", "supervision", "arro3")
PROMISED = {
    "calibrate": (
        "--out --lens --annotations --image-size --person-height --method --orientation "
        "--estimate-focal --frames --seed --format --drop-invalid --json"
    ),
    "orientation": "--lens --frames --out --json",
    "track": (
        "--camera --out --annotations --format --detector --rate --fps --drop-invalid --name "
        "--start --person-height --json"
    ),
    "watch": (
        "--camera --out --rate --give-up --search --alert --min-score --catalogue --zones "
        "--detector --name --person-height --json"
    ),
    "search": (
        "--top --min-score --min-probability --catalogue --zones --footage --out --actev --json"
    ),
    "align": "--out --anchor --max-offset --json",
    "fleet": "--out --ray --json",
    "evaluate pets": "--data --out --json",
    "evaluate towncentre": "--data --out --json",
    "evaluate virat": "--data --clip --image-size --out --json",
    "evaluate meva": "--data --out --json",
    "evaluate custom": "--camera --reference --points --image-size --out --json",
    "evaluate site": "--data --site --out --json",
    "export": "--to --out --from --image-size --run --anchor --json",
    "activities": "--catalogue --json",
    "view": "--out --search --zones --footage --no-video --json",
    "serve": "--port --host --token --zones --footage --json",
    "models": "--json",
    "demo": "--out --json",
}


ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def command_of(name: str) -> click.Command:
    command = typer.main.get_command(app)
    for word in name.split():
        command = command.commands[word]
    return command


def options_of(command: str) -> set[str]:
    return {name for parameter in command_of(command).params for name in parameter.opts}


def all_commands(command: click.Command, name: str = "") -> set[str]:
    below = getattr(command, "commands", None)
    if below is None:
        return {name}
    return {n for word, c in below.items() for n in all_commands(c, f"{name} {word}".strip())}


@pytest.mark.parametrize("command", PROMISED)
def test_every_promised_option_is_there_and_explained(run, command):
    result = run(*command.split(), "--help")
    assert result.exit_code == 0, result.stderr
    assert result.stderr == ""
    assert set(PROMISED[command].split()) <= options_of(command)
    assert {"--json", "-q", "--quiet", "-v", "--verbose"} <= options_of(command)
    shown = set(re.findall(r"--[a-z-]+", result.stdout))
    assert set(PROMISED[command].split()) <= shown
    assert "Example" in result.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_of_the_pages_name_what_exists(page):
    blocks = re.findall(r"^```(?:sh|bash)?\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    joined = re.sub(r"\\\n\s*", "", "\n".join(blocks))
    for line in re.findall(r"^(?:\S*/|docker run .* )?scene4d (.*)$", joined, re.MULTILINE):
        words = shlex.split(re.sub(r" {4,}.*", "", line), comments=True)
        names = [name for name in PROMISED if words[: len(name.split())] == name.split()]
        assert names or words == ["--version", "--json"], line
        options = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert not names or options <= options_of(names[-1]), line


def parsed(words: list[str]) -> None:
    """Raises for words that the command line does not take."""
    name, *rest = words
    command_of(name).make_context(name, rest)


def test_the_services_run_commands_that_exist_with_few_rights():
    services = yaml.safe_load((ROOT / "container" / "compose.yaml").read_text())["services"]
    for name in ("watch", "serve"):
        command = services[name]["command"]
        assert command[0] == name
        parsed([re.sub(r"\$\{.*\}", "rtsp://gate/live", word) for word in command])
        assert services[name]["read_only"] and services[name]["cap_drop"] == ["ALL"]
    lines = (ROOT / "container" / "Dockerfile").read_text().splitlines()
    assert lines.index("USER scene4d") < lines.index('ENTRYPOINT ["scene4d"]')
    entry = lines.index('ENTRYPOINT ["scene4d"]')
    assert json.loads(lines[entry + 1].removeprefix("CMD ")) == ["--help"]
    copied = [word for line in lines if line.startswith("COPY p") for word in line.split()[1:-1]]
    assert copied and all((ROOT / word).exists() for word in copied)


def test_there_are_no_other_commands():
    assert all_commands(typer.main.get_command(app)) == set(PROMISED)


@pytest.mark.parametrize("command", PROMISED)
def test_the_examples_name_what_exists(command):
    text = inspect.cleandoc(command_of(command).help)
    joined = re.sub(r"\\\n\s*", "", text)
    examples = re.findall(r"^\s+(?:\w+=\S+ )?(scene4d .*)$", joined, re.MULTILINE)
    assert len(examples) >= 2
    for example in examples:
        words = shlex.split(example)
        assert words[: 1 + len(command.split())] == ["scene4d", *command.split()]
        assert {word for word in words if word.startswith("--")} <= options_of(command), example


def test_paragraphs_wrap_at_the_width_of_the_terminal(spawn):
    narrow = spawn(["calibrate", "--help"], env={"COLUMNS": "60"}).stdout
    text = narrow[: narrow.index("Examples")]
    lines = [line.rstrip() for line in text.splitlines()]
    assert max(map(len, lines)) <= 60
    inner = [a for a, b in itertools.pairwise(lines) if a and b]
    assert min(map(len, inner)) > 40, "a paragraph is broken in the middle"


def test_export_names_every_format_that_is_written(run):
    text = " ".join(re.sub("[│╭╮╰╯─]", " ", run("export", "--help").stdout).split())
    camera, scene = text.split("For a camera:")[1].split("For a scene:")
    for known in camera_formats():
        assert (re.search(rf"\b{known.name}\b", camera) is not None) == (known.write is not None)
    assert all(known.name in scene.split(".")[0] for known in scene_formats())


def test_the_methods_are_those_of_the_solver():
    assert tuple(Method) == METHODS


def test_version(run):
    result = run("--version")
    assert result.exit_code == 0
    assert re.fullmatch(r"scene4d \d+\.\d+\.\d+\S*\n", result.stdout)
    module = [sys.executable, "-m", "scene4d", "--version"]
    assert subprocess.check_output(module, text=True) == result.stdout
    for words in (["--version", "--json"], ["--json", "--version"]):
        found = run(*words)
        assert found.exit_code == 0
        said = json.loads(found.stdout)
        assert said.pop("version") == result.stdout.split()[1]
        assert said == {"schema": "scene4d/version/1", "warnings": [], "error": None}


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
