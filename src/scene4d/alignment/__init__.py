"""Several cameras become one site: one ground, one clock, one identity."""
