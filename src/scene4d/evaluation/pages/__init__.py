"""Figures and page of ``scene4d evaluate``: the paper's, and what it left out.

Importing this package is light: matplotlib, OpenCV and Jinja are loaded when something is drawn.
"""

from scene4d.evaluation.pages.draw import FIGURES, draw_evaluation
from scene4d.evaluation.pages.page import render_evaluation

__all__ = ["FIGURES", "draw_evaluation", "render_evaluation"]
