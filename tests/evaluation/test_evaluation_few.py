"""The draws of a few people on the page and in the terminal."""

import evaluation_scenes as scenes
import numpy as np

from scene4d.cli.scores import show_evaluation
from scene4d.evaluation import FewPeople
from scene4d.evaluation.pages import render_evaluation

NAN, INF = float("nan"), float("inf")
FEW = (
    FewPeople("video <b>", 3, np.array([NAN, NAN, 2.5, 1.5]), np.array([1.25, NAN, 0.75, INF])),
    FewPeople("video <b>", 5, np.array([NAN]), np.array([NAN])),
)


def page(**changes: object) -> str:
    found = scenes.evaluation(scenes.park(), **changes)
    return render_evaluation(found, {}, command=None, version=None, timings={})


def test_the_page_has_a_line_per_number_of_people():
    text = page(few=FEW)
    assert "A few people in one frame" in text and "video &lt;b&gt;" in text
    assert text.count("and 1 failed") == 1
    assert ">1 of 2<" in text and ">1.25<" in text
    assert "A few people" not in page()


def test_the_terminal_shows_them(capsys):
    show_evaluation(scenes.evaluation(scenes.park(), few=FEW), None)
    shown = capsys.readouterr().out
    assert "2 refused, 1.50" in shown and "1 refused, 1.25" in shown
    assert "1 refused, none" in shown and "1 of 2" in shown
    show_evaluation(scenes.evaluation(scenes.park()), None)
    assert "few people" not in capsys.readouterr().out
