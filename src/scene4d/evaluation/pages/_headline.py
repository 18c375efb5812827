"""Which outcomes the figures and the verdict show: a rule that does not look at the scores."""

from dataclasses import dataclass

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.calibration import Calibration
from scene4d.evaluation.trials.outcomes import Evaluation, Outcome, Score, Setting

_WANTED_M = {"paper": 1.7018}
"""Height of people that stands for a method; :data:`PERSON_HEIGHT_M` for the others."""
_NAMES = {
    "paper": "the paper’s method",
    "joint": "the joint method",
    "given": "the given camera",
}
# Okabe and Ito (2008); the markers differ as well.
_LOOKS = {"paper": ("#D55E00", "X"), "joint": ("#0072B2", "o")}
_OTHER = ("#009E73", "D")
RULE = (
    "For each method the figures show one line of the table: for the paper’s method the first that "
    "is given what the network reads, at 1.7018 m as in its ROC figure; for the joint method the "
    "first that is given nothing, at 1.70 m; where these have no result, the first line of the "
    "method that has one. Circular lines are never shown. The rule does not look at the scores."
)


@dataclass(frozen=True, eq=False)
class Headline:
    """The outcome that stands for a method, with the look that it has in every figure."""

    setting: Setting
    person_height_m: float
    calibration: Calibration
    score: Score
    colour: str
    marker: str

    @property
    def method(self) -> str:
        """Name of the method, as in the table."""
        return self.setting.method

    @property
    def name(self) -> str:
        """The method in words, for the middle of a sentence."""
        return _NAMES.get(self.method, self.method)

    @property
    def ground_figure(self) -> str:
        """Name of the figure that shows the method's ground."""
        return f"ground_{self.method}" if self.method in _LOOKS else "ground_other"


def headlines(evaluation: Evaluation) -> tuple[Headline, ...]:
    """One outcome per method by :data:`RULE`: the paper's first, then the joint one, then others.

    A method without a result has none; of the other methods the first alone is taken.
    """
    others = [s.method for s in evaluation.settings() if s.method not in _LOOKS]
    found = []
    for method in [*_LOOKS, *others[:1]]:
        wanted = _WANTED_M.get(method, PERSON_HEIGHT_M)
        lines = [s for s in evaluation.settings() if s.method == method and not s.circular]
        at_wanted = [at_height(evaluation.of(setting), wanted) for setting in lines]
        results = [o for o in at_wanted if o.score is not None]
        if results:
            chosen = next((o for o in results if o.setting.headline), results[0])
            assert chosen.calibration is not None
            assert chosen.score is not None
            found.append(
                Headline(
                    chosen.setting, chosen.person_height_m, chosen.calibration, chosen.score,
                    *_LOOKS.get(method, _OTHER),
                )
            )  # fmt: skip
    return tuple(found)


def at_height(outcomes: list[Outcome], height_m: float) -> Outcome:
    """Of the outcomes of one line the one that assumes the mean height nearest to ``height_m``."""
    return min(outcomes, key=lambda outcome: abs(outcome.person_height_m - height_m))
