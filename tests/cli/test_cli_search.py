"""``scene4d search`` as a program."""

import csv
import json
import re
import shlex
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import finding_scenes as scenes
from scene4d.searching.activities.search import LEAST_SCORE

DOCS = Path(__file__).parents[2] / "docs" / "searching.md"
LANGUAGE = DOCS.with_name("search-language.md")


@pytest.fixture(scope="module")
def gate(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("cli") / "scene"
    return scenes.write_scene(folder, [*scenes.people(), scenes.parked()])


def test_it_says_what_it_understood_and_then_what_it_found(run, gate):
    result = run("search", gate, "person enters vehicle")
    assert result.exit_code == 0, result.stderr
    understood, found = result.stdout.split("1 event in 1 clip of 1 camera.")
    assert "Understood  person enters vehicle" in understood
    assert re.search(r"near\(person, vehicle[,)]", understood)
    assert re.search(r"1  0\.\d\d  00:\d\d\.\d to 00:1\d\.\d  camera gate", found)
    assert f"person {scenes.PERSON}, vehicle {scenes.PARKED}  in morning" in found
    assert found.count("robability: unknown") == 1
    assert re.search(r"disappears_into\([^)]*\)\s+[01]\.\d\d", found)


def test_explain_draws_every_predicate_over_time(run, gate, tmp_path):
    result = run("search", gate, "person enters vehicle", "--explain", "--out", tmp_path / "page")
    assert result.exit_code == 0, result.stderr
    curves = [
        line for line in result.stdout.splitlines() if re.match(r"\s*[▁▂▃▄▅▆▇█ ]{40}  \w", line)
    ]
    names = [line.split("  ")[-1] for line in curves]
    assert any(name.startswith("vanishes: disappears_into(") for name in names)
    assert "├" in result.stdout and "event; the line is -" in result.stdout
    page = (tmp_path / "page" / "search.html").read_text()
    assert page.count('<svg class="course"') == len(curves)
    assert 'points="0.0,' in page
    plain = run("search", gate, "person enters vehicle")
    assert "█" not in plain.stdout


def test_json_is_one_object_with_every_event(run, gate):
    result = run("search", gate, "person moves", "--top", "1", "--json", "--min-score", "0.2")
    assert result.exit_code == 0, result.stderr
    values = json.loads(result.stdout)
    assert list(values)[4:] == ["query", "predicates", "events"]
    assert len(values["events"]) > 1
    assert all(one["score"] >= 0.2 for one in values["events"])


def test_several_searches_in_one_command(run, gate, tmp_path):
    actev, table = tmp_path / "all.json", tmp_path / "all.csv"
    words = "two people meet; person enters vehicle"
    result = run("search", gate, words, "--actev", actev, "--csv", table)
    assert result.exit_code == 0, result.stderr
    assert "person enters vehicle: 1 event in 1 clip" in result.stdout
    activities = [one["activity"] for one in json.loads(actev.read_text())["activities"]]
    assert set(activities) == {"people_meet", "person_enters_vehicle"}
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["activity"] for row in rows] == activities
    assert rows[-1]["vehicle"] == str(scenes.PARKED) and not rows[0]["vehicle"]
    result = run("search", gate, "all activities", "--json")
    searches = json.loads(result.stdout)["searches"]
    assert len(searches) > 10
    assert {"query", "predicates", "events"} == set(searches[0])
    result = run("search", gate, "person moves; person stands", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "--out" in result.stderr
    assert not (tmp_path / "out").exists()


def test_top_shows_the_best(run, gate):
    result = run("search", gate, "person moves", "--top", "1")
    assert "The 1 best of them:" in result.stdout
    assert "\n  1  " in result.stdout
    assert "\n  2  " not in result.stdout


def test_no_event_scores_less_than_a_thousandth_and_help_and_page_say_so(run, gate):
    def events(least):
        result = run("search", gate, "person moves", "--json", "--min-score", least)
        return json.loads(result.stdout)["events"]

    assert events("0") == events(f"{LEAST_SCORE:g}") != []
    said = " ".join(re.sub("[│╭╮╰╯─]", " ", run("search", "--help").stdout).split())
    assert f"values below {LEAST_SCORE:g} count as {LEAST_SCORE:g}" in said
    assert f"so 0 means {LEAST_SCORE:g}" in " ".join(DOCS.read_text().split())


def test_nothing_found_is_no_error(run, gate):
    result = run("search", gate, "person enters vehicle", "--min-score", "1")
    assert result.exit_code == 0
    said = r"Nothing found in 1 clip of 1 camera: of \d candidate pairs? \(person, vehicle\)"
    assert re.search(said, result.stdout)
    empty = run("search", gate, "person enters vehicle", "--min-score", "1", "--json")
    assert json.loads(empty.stdout)["events"] == []


def test_files_are_written(run, gate, tmp_path):
    out, actev = tmp_path / "deep" / "out", tmp_path / "actev.json"
    result = run("search", gate, "two people meet", "--out", out, "--actev", actev)
    assert result.exit_code == 0, result.stderr
    assert sorted(path.name for path in out.iterdir()) == ["events.json", "search.html"]
    assert json.loads(actev.read_text())["filesProcessed"] == ["morning"]
    assert str(out / "search.html") in result.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("person enters vehicel", "vehicle"),
        ("bus stops", "the scene has no bus"),
        ("person in zone bay", "bay"),
    ],
)
def test_what_cannot_be_searched_is_one_line(run, gate, words, says):
    result = run("search", gate, words)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert says in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--top", "0"], "--top"),
        (["--min-score", "1.5"], "--min-score"),
        (["--footage", "x.mp4"], "--footage"),
    ],
)
def test_wrong_usage(run, gate, arguments, says):
    result = run("search", gate, "person moves", *arguments)
    assert result.exit_code == 2
    assert says in re.sub("[│╭╮╰╯─]", " ", result.stderr)


def test_forgotten_quotes_are_recognised(run, gate):
    result = run("search", gate, "person", "enters", "vehicle")
    assert result.exit_code == 2
    assert "in quotes" in " ".join(re.sub("[│╭╮╰╯─]", " ", result.stderr).split())


def test_a_folder_without_a_scene(run, tmp_path):
    result = run("search", tmp_path, "person moves")
    assert result.exit_code == 1
    assert "holds no scene" in result.stderr


def test_bad_files_are_named(run, gate, tmp_path):
    bow = tmp_path / "bow.json"
    bow.write_text('{"zones": {"bow": [[0, 0], [4, 4], [4, 0], [0, 4]]}}')
    result = run("search", gate, "person in zone bow", "--zones", bow)
    assert result.exit_code == 1
    assert "bow.json" in result.stderr
    assert "crosses itself" in result.stderr
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        "activities:\n  x:\n    roles: {person: person}\n"
        '    phases:\n      - {name: p, holds: ["movin(person)"]}\n'
    )
    result = run("search", gate, "person moves", "--catalogue", mine)
    assert result.exit_code == 1
    assert re.search(r"mine\.yaml, line \d.*did you mean 'moving'", result.stderr)


def test_what_failed_leaves_no_folder(run, gate, tmp_path):
    result = run(
        "search", gate, "person moves", "--out", tmp_path / "out", "--footage", tmp_path / "gone"
    )
    assert result.exit_code == 1
    assert "gone" in result.stderr
    assert not (tmp_path / "out").exists()


def test_the_python_of_the_page_on_searching_runs(gate, tmp_path, monkeypatch, capsys):
    """docs/searching.md, with this scene as ``scene``."""
    (tmp_path / "scene").symlink_to(gate)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)
    assert blocks
    scope: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "searching.md", "exec"), scope)
    assert f"person {scenes.PERSON} enters vehicle {scenes.PARKED}" in capsys.readouterr().out


def test_what_the_page_on_searching_says_is_understood_is_what_is_printed(run, gate):
    (shown,) = re.findall(r"```\n(Understood .*?)```", DOCS.read_text(), re.DOTALL)
    asked = re.search(r'scene4d search scene "(.*)"', DOCS.read_text())[1]
    result = run("search", gate, asked)
    assert result.stdout.startswith(shown + "\n")


def test_what_the_page_on_words_says_is_understood_is_what_is_printed(run, tmp_path):
    evening = datetime(2026, 11, 20, 21, 30, tzinfo=UTC)
    everybody = [*scenes.people(), scenes.parked()]
    watched_s = tuple(np.arange(0, scenes.SECONDS, 0.5).tolist())
    scene = scenes.write_scene(tmp_path / "scene", everybody, start=evening, watched_s=watched_s)
    zones = tmp_path / "zones.json"
    zones.write_text(json.dumps({"zones": {"car park": [[-3, 7], [3, 7], [3, 10], [-3, 10]]}}))
    pages = re.findall(r"```\n(Understood .*?)```", LANGUAGE.read_text(), re.DOTALL)
    none = "none scores 0.05 or more"
    for shown, found in zip(pages, ("1 event in 1 clip", none, none), strict=True):
        asked = shown.splitlines()[0].removeprefix("Understood").strip()
        given = ("--zones", zones) if "zone=" in shown else ()
        result = run("search", scene, asked, *given)
        assert result.stdout.startswith(shown), result.stderr
        assert found in result.stdout


def test_the_commands_of_the_page_on_searching_run(run, gate, tmp_path, monkeypatch):
    (tmp_path / "scene").symlink_to(gate)
    monkeypatch.chdir(tmp_path)
    text = DOCS.read_text()
    for name, content in re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", text, re.DOTALL):
        (tmp_path / name).write_text(content)
    commands = re.findall(r"^scene4d (search .*)$", text.replace("\\\n", " "), re.MULTILINE)
    assert len(commands) >= 5
    for command in commands:
        result = run(*shlex.split(command, comments=True))
        assert result.exit_code == 0, (command, result.stderr)
