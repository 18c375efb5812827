"""The errors that scene4d raises on purpose."""


class Scene4DError(Exception):
    """Base of every error that scene4d raises on purpose; its text is one readable sentence.

    The remedy follows the last semicolon. ``kind`` names the class for programs.
    """

    kind = "failed"


class InputError(Scene4DError, ValueError):
    """Bad input: the text names the file, the line or field, what was found, what was expected."""

    kind = "input"


class UnavailableError(Scene4DError):
    """Something outside the program is missing: a weight, a sample, an optional library."""

    kind = "unavailable"


class OutputError(Scene4DError):
    """A result could not be written; what was there before is untouched."""

    kind = "output"
