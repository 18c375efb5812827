"""How an evaluation is shown: one self-contained page with its figures."""
