"""The table of a few people in one frame, with and without the orientation network."""

from dataclasses import dataclass

from scene4d.drawing.words import number
from scene4d.evaluation import FewPeople

_NONE = "–"
_COLUMNS = (
    "people", "draws", "refused without", "median without", "refused with", "median with",
    "both gave one", "median without", "median with", "closer with",
)  # fmt: skip


@dataclass(frozen=True)
class FewLine:
    """One line: the footage, and (label, text) of each cell."""

    footage: str
    cells: list[tuple[str, str]]

    @property
    def labels(self) -> list[str]:
        """The headings of the columns after the footage."""
        return [label for label, _ in self.cells]


def few_line(row: FewPeople) -> FewLine:
    """The draws of one number of people."""
    values = row.to_dict()
    alone, guided, both = values["nothing"], values["network"], values["where_both"]
    texts = (
        str(row.people),
        str(row.draws),
        _refused(alone["refused"], alone["failed"]),
        _metres(alone["median_m"]),
        _refused(guided["refused"], guided["failed"]),
        _metres(guided["median_m"]),
        str(row.both),
        _metres(both["nothing_median_m"]),
        _metres(both["network_median_m"]),
        f"{row.closer} of {row.both}" if row.both else _NONE,
    )
    return FewLine(row.footage, list(zip(_COLUMNS, texts, strict=True)))


def _metres(value: float | None) -> str:
    return _NONE if value is None else number(value, 2)


def _refused(refused: int, failed: int) -> str:
    """A camera under whose horizon not all points lie was given, but is none."""
    return f"{refused}, and {failed} failed" if failed else str(refused)
