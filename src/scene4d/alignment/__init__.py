"""Several cameras become one site: one ground, one clock, one identity."""

from scene4d.alignment._options import AlignOptions
from scene4d.alignment.aligning import Alignment, align

__all__ = ["AlignOptions", "Alignment", "align"]
