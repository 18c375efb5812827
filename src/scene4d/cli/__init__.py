"""The command line: one thin file per command; nothing heavy is imported before a command runs."""

import os


def main() -> None:
    """Run ``scene4d`` on the arguments of this process, and end it with the exit code."""
    # onnxruntime from 1.29 on reports its use to its maker, from the moment it is imported.
    # Whoever watches a camera must not be surprised by that.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    from scene4d.cli.app import app

    app(prog_name="scene4d")
