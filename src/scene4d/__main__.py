"""``python -m scene4d`` is the command ``scene4d``."""

from scene4d.cli import main

main()
