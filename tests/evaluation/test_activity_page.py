"""The page of an evaluation of activity search, its table and its DET curves."""

import json
from html.parser import HTMLParser

import activity_evaluations as made
import cv2
import numpy as np
import pytest

from scene4d.evaluation.measures._events import DetCurve
from scene4d.evaluation.pages._activities import render_activities, sheets, verdict
from scene4d.evaluation.pages._charts import LEAST, MOST, draw_det, outline


class Page(HTMLParser):
    """Visible text, and what the page loads."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.text, self.links, self._style = "", [], False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self._style = tag == "style"
        self.links += [v for k, v in attrs if k in ("src", "href") and v]

    def handle_endtag(self, tag):
        self._style = False

    def handle_data(self, data):
        self.text += "" if self._style else data


@pytest.fixture(scope="module")
def evaluation():
    return made.whole()


@pytest.fixture(scope="module")
def page(evaluation):
    return render_activities(
        evaluation,
        {"det": draw_det(evaluation)},
        command="scene4d evaluate meva --data 'my <data>'",
    )


def test_the_page_says_what_it_does_not_show(page):
    text = Page(page).text
    for said in (*made.NOTES, "G3 and G4", "G1, G2", "a < b", "'my <data>'"):
        assert said in text
    assert all(link.startswith("data:") for link in Page(page).links)


def test_the_table_by_method(evaluation):
    sheet = sheets(evaluation)[0]
    assert [line.activity for line in sheet.lines] == [
        "person enters vehicle", "person exits vehicle", "vehicle stops", "vehicle turns left",
        "mean",
    ]  # fmt: skip
    assert {len(line.cells) for line in sheet.lines} == {3 + 2}
    first = sheet.lines[0]
    assert first.labelled == "73"
    assert first.names == "person_enters_vehicle_label"
    ours = evaluation.of("metres", "person_enters_vehicle")
    assert first.cells[0].text == f"{ours.average_precision:.2f}"
    assert first.cells[3].text == f"{ours.missed_at(0.15):.2f}"
    assert first.cells[4].text == f"{ours.missed_at(0.02):.2f}"
    assert [cell.best for cell in first.cells] == [True, False, False, False, False]
    assert sheet.lines[2].cells[2].text == "–"
    assert not sheet.lines[2].cells[2].best


def test_the_table_by_rule_and_camera(evaluation):
    sheet = sheets(evaluation)[1]
    assert [group for group, _ in sheet.groups] == ["all cameras", "G3", "G4"]
    cells = sheet.lines[0].cells
    ours = evaluation.ours("person_enters_vehicle")
    low, high = ours.interval("1 s")
    assert low < ours.average_precision < high
    assert cells[0].text == f"{ours.average_precision:.2f} [{low:.2f}, {high:.2f}]"
    assert cells[4].text == f"{ours.precision_by('1 s', 'G3'):.2f}"
    assert cells[8].label == "G4, 1 s"


def test_the_table_of_probabilities(evaluation):
    sheet = sheets(evaluation)[2]
    trust = evaluation.ours("person_enters_vehicle").trust
    # Scores from 0 to 2 become 0.1 to 0.9.
    score = evaluation.ours("person_enters_vehicle").ranked.score
    shown = score[score >= 0.05]
    assert trust.events == len(shown)
    assert trust.stated == pytest.approx(np.mean(0.1 + 0.4 * shown))
    texts = [cell.text for cell in sheet.lines[0].cells]
    alone = trust.without_chance
    columns = [trust.stated, trust.right, trust.expected_error, alone.floor, alone.chance]
    columns += [alone.debiased, alone.low, alone.high]
    assert texts == [f"{v:.2f}" for v in columns]
    assert [cell.text for cell in sheet.lines[2].cells] == ["–"] * 8  # stops are not calibrated


def test_the_mean_leaves_out_what_a_method_cannot_look_for(evaluation):
    names = [name for name in evaluation.activities if name.startswith("person")]
    values = [evaluation.of("near", name).average_precision for name in names]
    assert evaluation.mean_average_precision("near") == pytest.approx(np.mean(values))
    assert f"{np.mean(values):.2f} by near over the 2 that it can search for" in verdict(evaluation)


def test_json(evaluation):
    found = json.loads(json.dumps(evaluation.to_dict(), allow_nan=False))
    assert found["cameras"] == {"tuned": ["G1", "G2"], "reported": ["G3", "G4"]}
    assert found["notes"] == list(made.NOTES)
    by_name = {row["activity"]: row for row in found["activities"]}
    one = by_name["person_enters_vehicle"]["methods"]["metres"]
    assert set(one["p_miss"]) == {"0.15", "0.02"}
    assert 0 < one["average_precision"] < 1
    assert one["correct"] < one["found"]
    assert by_name["vehicle_stops"]["methods"]["near"]["average_precision"] is None
    rules = by_name["vehicle_stops"]["rules"]
    assert rules["1 s"]["average_precision"] >= rules["IoU 0.5"]["average_precision"]
    assert set(rules["IoU 0.2"]["cameras"]) == {"G3", "G4"}
    assert by_name["vehicle_stops"]["probability"] is None
    assert by_name["person_enters_vehicle"]["probability"]["events"] > 0
    assert by_name["nothing_of_it"]["methods"]["metres"]["average_precision"] is None


def test_nothing_labelled():
    nothing = made.made({"nothing_of_it": 0})
    assert "Nothing is labelled" in verdict(nothing)
    assert draw_det(nothing)
    assert "Nothing is labelled" in render_activities(nothing, {}, command=None)


def test_the_outline_of_a_curve():
    curve = DetCurve(np.array([0.0, 0.0, 0.1, 0.5]), np.array([0.9, 0.8, 0.6, 0.3]))
    x, y = outline(curve)
    assert x.tolist() == [LEAST, 0.1, 0.5, MOST]
    assert y.tolist() == [0.8, 0.6, 0.3, 0.3]
    x, y = outline(DetCurve(np.array([0.1, 0.5]), np.array([0.6, 0.3])))
    assert x.tolist() == [LEAST, 0.1, 0.1, 0.5, MOST]
    assert y.tolist() == [1.0, 1.0, 0.6, 0.3, 0.3]
    x, y = outline(DetCurve(np.array([0.0, 5.0]), np.array([0.6, 0.3])))
    assert x.tolist() == [LEAST, 5.0, 5.0]
    assert y.tolist() == [0.6, 0.3, 0.3]
    only = outline(DetCurve(np.array([0.0]), np.array([0.6])))
    assert [values.tolist() for values in only] == [[LEAST, MOST], [0.6, 0.6]]
    nothing = outline(DetCurve(np.zeros(0), np.zeros(0)))
    assert [values.tolist() for values in nothing] == [[LEAST, MOST], [1.0, 1.0]]


def test_the_figure_has_a_panel_for_each_activity(evaluation):
    few = cv2.imdecode(np.frombuffer(draw_det(evaluation).png, np.uint8), cv2.IMREAD_COLOR)
    many = made.made({f"person_does_{k}": 5 for k in range(9)})
    tall = cv2.imdecode(np.frombuffer(draw_det(many).png, np.uint8), cv2.IMREAD_COLOR)
    assert tall.shape[1] == few.shape[1]
    assert tall.shape[0] > 1.3 * few.shape[0]
