"""The page of an evaluation: its numbers, its honesty, and that it stands alone."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib.metadata import version

import evaluation_scenes as scenes
import numpy as np
import pytest

import report_scenes
from scene4d.drawing.style import Drawn
from scene4d.evaluation.pages._headline import headlines
from scene4d.evaluation.pages._table import Line, table
from scene4d.evaluation.pages._words import compared, paragraphs, verdict
from scene4d.evaluation.pages.page import draw_evaluation, render_evaluation
from scene4d.evaluation.trials.outcomes import Evaluation, Outcome

VOID = {"meta", "img", "br", "hr", "link"}


class Text(HTMLParser):
    """The visible text of a page; every tag must be closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.links: list[str] = []
        self.alts: list[str] = []
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [v for k, v in attrs if k in ("src", "href", "srcset", "action") and v]
        self.alts += [v or "" for k, v in attrs if k == "alt"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data


def rendered(evaluation: Evaluation, pictures: dict[str, Drawn] | None = None) -> str:
    command = "scene4d evaluate towncentre --data 'my <data>'"
    return render_evaluation(evaluation, pictures or {}, command=command)


@pytest.fixture(scope="module")
def whole():
    return scenes.whole()


@pytest.fixture(scope="module")
def page(whole):
    return rendered(whole, scenes.drawn())


def line(evaluation: Evaluation, footage: str) -> Line:
    return next(x for x in table(evaluation).lines if x.footage == footage)


def test_the_page_stands_alone(page, whole):
    found = Text(page)
    assert len(found.links) == len(found.alts) == len(scenes.drawn())
    assert all(link.startswith("data:image/") for link in found.links)
    assert all(len(alt) > 20 for alt in found.alts)
    without = re.sub(r"data:image/[^\"]+", "", page)
    assert not re.search(r"https?:|//[a-z]|@import|url\(|<script|<link", without)
    assert "@media print" in page and "viewport" in page
    assert "nan" not in found.text.lower()
    assert len(page) < 4_000_000


def test_text_from_outside_is_escaped(page):
    assert "f &lt; g" in page and "keypoints &lt;video&gt;" in page and "my &lt;data&gt;" in page
    assert "<is>" not in page and "<video>" not in page


def test_it_says_what_was_measured_and_where_it_comes_from(page):
    text = Text(page).text
    assert "12 points, spread over the ground where people walked" in text
    assert "the true camera of a park" in text
    assert "TownCentre" in text and version("scene4d") in text
    assert "the network <is> missing" in text
    assert "The rule does not look at the scores." in text


def test_the_error_of_a_wrong_scale_is_the_one_worked_out_by_hand(whole):
    """A camera 2 % too high makes the scene 2 % too large about the points' mean."""
    known = whole.reference
    true = known.locate(known.points_uv)[0]
    scale = 1.02 * 1.7018 / 1.70
    off = (scale - 1) * np.linalg.norm(true - true.mean(axis=0), axis=1)
    text = f"{off.mean():.2f} ± {off.std():.2f}\u00a0m with the paper’s method"
    assert text in verdict(whole)
    cell = line(whole, "drawn boxes").cells[2]
    assert cell.text == f"{off.mean():.2f} ± {off.std():.2f}"
    assert table(whole).columns[2] == "1.7018 m"


def test_the_table_has_a_line_for_every_setting_and_the_truth_and_the_paper(whole):
    made = table(whole)
    kinds = [x.kind for x in made.lines]
    assert kinds == ["", "circular", "", "", "truth", "published"]
    assert {len(x.cells) for x in made.lines} == {len(made.columns)} == {9}
    published = made.lines[-1]
    assert [c.text for c in published.cells[:4]] == ["–", "–", "–", "1.18 ± 0.67"]
    assert published.cells[5].text == "0.98"
    assert "1.7018 m" in made.notes[published.cells[5].note - 1]
    assert [c.text for c in made.lines[-2].cells[-3:]] == ["1185\u00a0px", "16.5°", "7.07\u00a0m"]


def test_a_refusal_carries_its_reason_where_print_shows_it(whole, page):
    made = table(whole)
    cells = made.lines[2].cells
    assert [c.text for c in cells] == ["refused"] * 4 + ["–"] * 5
    reason = "Boxes alone do not determine f < g."
    assert made.notes[cells[0].note - 1] == reason
    assert made.notes.count(reason) == 1
    text = Text(page).text
    assert reason in text
    assert "1 row gave no result" in text
    assert 'title="boxes alone do not determine f &lt; g"' in page


def test_what_was_told_is_told_apart_from_what_was_found(whole):
    paper, joint = line(whole, "drawn boxes").cells, line(whole, "keypoints <video>").cells
    assert [c.told for c in paper[-3:]] == [True, True, False]
    assert not any(c.told for c in joint)
    assert (joint[-3].text, joint[-3].off) == ("1280\u00a0px", "+8.0\u00a0%")
    assert (paper[-3].off, paper[-2].off) == ("0.0\u00a0%", "0.0°")
    assert paper[-1].off == "+0.14\u00a0m"  # 2 % of 7.07 m


def test_the_prediction_stands_beside_the_same_measure_of_the_error(whole):
    shown = headlines(whole)[1]
    expected = shown.score.predicted_m
    assert expected > 0
    rms = float(np.sqrt(np.mean(shown.score.error.distance_m**2)))
    assert line(whole, "keypoints <video>").cells[4].text == f"{expected:.2f}\u00a0/\u00a0{rms:.2f}"


def test_circular_lines_are_marked_and_claim_nothing(whole, page):
    assert '<tr class="circular">' in page and "circular" in Text(page).text
    said = verdict(whole) + " ".join(paragraphs(whole))
    assert "1 of 4 rows had circular input" in said
    alone = replace(whole, outcomes=tuple(o for o in whole.outcomes if o.setting.circular))
    assert "There is no result" in verdict(alone)
    assert headlines(alone) == ()
    assert "0.00 ±" not in verdict(alone) + " ".join(paragraphs(alone))
    # Grey in the table, and in no figure.
    assert list(draw_evaluation(alone)) == ["points"]
    assert "no result that counts" in Text(rendered(alone)).text


@pytest.mark.parametrize(
    ("paper", "joint", "words"),
    [
        (1.01, 1.10, "further from the truth"),
        (1.10, 1.01, "closer to the truth"),
        (1.05, 1.05, "less than 12 points can resolve"),
    ],
)
def test_whoever_loses_is_said_to_lose(paper, joint, words):
    known = scenes.park()
    both = (
        *scenes.line(scenes.PAPER, known, scale=paper * 1.70 / 1.7018),
        *scenes.line(scenes.JOINT, known, scale=joint),
    )
    evaluation = scenes.evaluation(known, outcomes=both)
    first, second = headlines(evaluation)
    said = compared(first, second)
    assert words in said
    assert "different input" in said
    gap = abs(first.score.error.mean_m - second.score.error.mean_m)
    assert f"{gap:.2f}\u00a0m" in said
    assert said in Text(rendered(evaluation)).text


def test_a_map_of_the_ground_has_no_camera_to_compare_with():
    known = scenes.reference(scenes.ground_map(report_scenes.camera()))
    evaluation = scenes.evaluation(known)
    text = Text(rendered(evaluation)).text
    assert "the true map of the ground of a park" in text
    assert "it has no focal length, tilt or height to compare with" in text
    made = table(evaluation)
    assert "truth" not in [x.kind for x in made.lines]
    assert not any(cell.off for x in made.lines for cell in x.cells)
    assert line(evaluation, "keypoints <video>").cells[-3].text == "1280\u00a0px"


def test_one_method_alone_is_shown_alone_and_the_page_says_so(whole):
    outcomes = tuple(
        replace(o, score=None, reason="too few people") if o.setting.method == "paper"
        else o
        for o in whole.outcomes
    )  # fmt: skip
    alone = replace(whole, outcomes=outcomes)
    text = Text(rendered(alone)).text
    assert "The paper’s method has no result that counts" in text
    assert "with the joint method (given nothing)" in text and "with the paper’s method" not in text


def test_a_bare_camera_of_a_user_gets_a_page():
    known = replace(scenes.park(), n_points=3)
    only = scenes.line(replace(scenes.PAPER, method="given", given=""), known, scale=1.01)[1]
    bare = replace(only.calibration, covariance=None, segments=None, inlier=None)
    evaluation = Evaluation("custom", known, (Outcome.scored(only.setting, bare, known),))
    text = Text(rendered(evaluation)).text
    assert "with the given camera." in text
    assert "3 points, spread over the ground, were located" in text
    assert "people walked" not in text and "The paper reports" not in text
    assert table(evaluation).lines[0].cells[1].text.startswith("–")


def test_no_outcome_at_all_still_gives_a_page(whole):
    nobody = replace(whole, outcomes=tuple(scenes.refused(scenes.JOINT, "nobody was seen.")))
    text = Text(rendered(nobody)).text
    assert "There is no result for a park" in text
    assert "Nobody was seen." in text
    assert "The rule does not look" not in text
