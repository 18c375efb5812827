"""The command line: one thin file per command; nothing heavy is imported before a command runs."""


def main() -> None:
    """Run ``scene4d`` on the arguments of this process, and end it with the exit code."""
    from scene4d.cli.app import app

    app(prog_name="scene4d")
