"""The command line: one thin file per command; heavy modules load only when a command runs."""

import gc
import os
import signal
import sys
from types import FrameType

from scene4d.core.errors import Scene4DError

_GARBAGE = 20_000
"""Objects between collections: by default (700) they take 0.3 s while modules load, for nothing."""


def main() -> None:
    """Run ``scene4d`` on the arguments of this process, and end it with the exit code."""
    # onnxruntime 1.29 and later sends telemetry as soon as it is imported. Camera footage is
    # sensitive, so this is switched off.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    gc.set_threshold(_GARBAGE, 10, 10)
    try:
        from scene4d.cli.app import app

        signal.signal(signal.SIGTERM, _terminated)
        app(prog_name="scene4d")
    except KeyboardInterrupt:
        _end("interrupted", 130)
    except Scene4DError as error:  # a version that cannot be printed
        _end(f"error: {error}", 1)
    except OSError as error:  # help that cannot be printed
        _end(f"error: standard output cannot be written: {error.strerror}", 1)


def _terminated(signal_number: int, frame: FrameType | None) -> None:
    from scene4d.cli.command import Terminated

    raise Terminated


def _end(text: str, code: int) -> None:
    """Write one line to stderr and exit at once, without flushing stdout again."""
    sys.stderr.write(f"scene4d: {text}\n")
    sys.stderr.flush()
    os._exit(code)
