"""Figures that several rooms draw: the overlay, the view from above, one style, one base page."""
