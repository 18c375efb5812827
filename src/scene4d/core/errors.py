"""The errors that scene4d raises on purpose, and nothing else."""


class Scene4DError(Exception):
    """Base of every error that scene4d raises on purpose; its text is one readable sentence."""


class InputError(Scene4DError, ValueError):
    """Bad input: the text names the file, the line or field, what was found, what was expected."""


class UnavailableError(Scene4DError):
    """Something outside the program is missing: a weight, a sample, an optional library."""


class OutputError(Scene4DError):
    """A result could not be written; what was there before is untouched."""
