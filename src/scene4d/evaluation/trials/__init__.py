"""The paper's experiments, and ours beside them, on recordings with a known truth."""

from scene4d.evaluation.trials.custom import evaluate_custom
from scene4d.evaluation.trials.datasets import evaluate_pets, evaluate_towncentre, evaluate_virat
from scene4d.evaluation.trials.files import write_evaluation

__all__ = [
    "evaluate_custom",
    "evaluate_pets",
    "evaluate_towncentre",
    "evaluate_virat",
    "write_evaluation",
]
