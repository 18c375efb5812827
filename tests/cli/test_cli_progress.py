"""What people see of long work where there is no terminal."""

import pytest

from scene4d.cli import progress


def test_a_long_stage_tells_how_far_it_is(monkeypatch: pytest.MonkeyPatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.Lines().stage("Watching", 400) as step:
        for _ in range(400):
            now[0] += 0.25
            step(1)
    assert capsys.readouterr().err.splitlines() == [
        "scene4d: Watching: 120 of 400",
        "scene4d: Watching: 240 of 400",
        "scene4d: Watching: 360 of 400",
    ]


def test_an_endless_stage_tells_how_much_was_done(monkeypatch: pytest.MonkeyPatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.Lines().stage("Watching", None) as step:
        now[0] += 31
        step(7)
    assert capsys.readouterr().err == "scene4d: Watching: 7\n"


def test_a_short_stage_says_nothing(capsys):
    with progress.Lines().stage("Solving", None) as step:
        step(1)
    assert capsys.readouterr().err == ""
