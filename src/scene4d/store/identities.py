"""Which tracks of a site are one and the same: a table beside ``site.json``."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.core.tables import read_table
from scene4d.core.tracks import Tracks


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

    def cameras_each(self) -> dict[int, int]:
        """How many cameras saw each identity."""
        _, camera = np.unique(self.camera, return_inverse=True)
        pairs = np.unique(np.column_stack([self.identity, camera]), axis=0)
        number, count = np.unique(pairs[:, 0], return_counts=True)
        return dict(zip(number.tolist(), count.tolist(), strict=True))

    def of(self, camera: str) -> "Identities":
        """The rows of one camera."""
        return self.select(self.camera == camera)

    def numbered(self, tracks: Tracks) -> Tracks:
        """Tracks of the one camera whose rows these are, by identity and ordered by (track, time);
        without those that have none.
        """
        if not len(self):
            return tracks.select(np.zeros(len(tracks), bool))
        order = np.argsort(self.track)
        place = np.minimum(np.searchsorted(self.track[order], tracks.track), len(order) - 1)
        there = self.track[order][place] == tracks.track
        found = replace(tracks, track=self.identity[order][place]).select(there)
        return found.select(np.lexsort((found.time_s, found.track)))

    @classmethod
    def load(cls, path: Path) -> "Identities":
        """Read the file; raises :class:`InputError` for another table."""
        table = read_table(path)
        kinds = {"camera": "U", "track": "i", "identity": "i", "probability": "f"}
        for name, kind in kinds.items():
            if name not in table or table[name].dtype.kind != kind:
                raise InputError(f"{path}: expected the columns {', '.join(kinds)}; align again")
        return cls(**{name: table[name] for name in kinds})
