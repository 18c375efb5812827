"""What a user may say about an alignment."""

from dataclasses import dataclass
from pathlib import Path

from scene4d.core.errors import InputError

MAX_OFFSET_S = 600.0
"""Clocks are set to within ten minutes of each other, unless it is known better."""
_LONGEST_S = 86_400.0


@dataclass(frozen=True)
class AlignOptions:
    """The options of an alignment.

    ``anchor`` is a file of ground points whose place on the Earth or on a floor plan is known, of
    lines of a map that tracks keep to, or of cameras that are known
    (:mod:`scene4d.formats.anchors`). ``max_offset_s`` is how far apart
    clocks may be: of cameras whose start is known by how much they are set wrong, else by how much
    later one clip begins than another. ``pictures`` says whether ``plan.png`` and ``pairs/`` are
    drawn.
    """

    anchor: str | Path | None = None
    max_offset_s: float = MAX_OFFSET_S
    pictures: bool = True

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        if not 0 < self.max_offset_s <= _LONGEST_S:
            raise InputError(
                f"max_offset_s must lie above 0 and be at most a day, found {self.max_offset_s}"
            )
