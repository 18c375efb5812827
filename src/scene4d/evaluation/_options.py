"""What a user may say about an evaluation."""

from dataclasses import dataclass
from pathlib import Path

from scene4d.core.errors import InputError

TUNED = ("G341", "G424")
"""MEVA's cameras whose clips every constant of the search was chosen on."""
REPORTED = ("G328", "G506")
"""MEVA's cameras that are reported by default, and that nothing was chosen on."""


@dataclass(frozen=True)
class EvaluateOptions:
    """Options of the ``evaluate_*`` functions; each uses those that its data set needs.

    ``clip`` names a clip of VIRAT (the first by default). ``image_size`` is that of the footage,
    where no file says it. ``points`` is a file of ground points in pixels, for
    :func:`.evaluate_custom` and :func:`.evaluate_footage`. ``cameras`` are those of MEVA to report.
    """

    clip: str | None = None
    image_size: tuple[int, int] | None = None
    points: str | Path | None = None
    cameras: tuple[str, ...] = REPORTED

    def __post_init__(self) -> None:
        """Raises :class:`InputError` for a camera that constants were chosen on."""
        seen_before = sorted(set(self.cameras) & set(TUNED))
        if seen_before:
            raise InputError(
                f"camera {', '.join(seen_before)}: constants were chosen on it, so that it proves "
                f"nothing; report others, such as {' and '.join(REPORTED)}"
            )
