"""Figures and the self-contained page by which a person judges a calibration."""
