"""Figures and the self-contained page by which a person judges a calibration.

Importing this package is light: matplotlib, OpenCV and Jinja are loaded when a report is written.
"""

from scene4d.calibration.report.page import FIGURES, write_report

__all__ = ["FIGURES", "write_report"]
