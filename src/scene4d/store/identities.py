"""Which tracks of a site are one and the same: a table beside ``site.json``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.core.tables import read_table


@dataclass(frozen=True, eq=False)
class Identities(Columns):
    """Which tracks are one and the same: ``identity`` is the number of a person or vehicle in the
    whole site, ``track`` that in the scene of ``camera``. ``probability`` is that of the row: that
    the track belongs to its identity; 1 for the track that an identity began with.
    """

    camera: np.ndarray
    track: Int[np.ndarray, "n"]
    identity: Int[np.ndarray, "n"]
    probability: Float[np.ndarray, "n"]

    def __post_init__(self) -> None:
        self.check_rows("identities")

    def columns(self) -> dict[str, np.ndarray]:
        """1-D columns with their names in the file."""
        return {name: getattr(self, name) for name in self.array_names()}

    @classmethod
    def load(cls, path: Path) -> "Identities":
        """Read the file; raises :class:`InputError` for another table."""
        table = read_table(path)
        kinds = {"camera": "U", "track": "i", "identity": "i", "probability": "f"}
        for name, kind in kinds.items():
            if name not in table or table[name].dtype.kind != kind:
                raise InputError(f"{path}: expected the columns {', '.join(kinds)}; align again")
        return cls(**{name: table[name] for name in kinds})
