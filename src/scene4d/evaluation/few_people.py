"""A few people in one frame: what the joint method makes of them with and without a guess."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.evaluation.reference import Reference


def few_error_m(found: Calibration, reference: Reference) -> float:
    """Mean correspondence error in metres; NaN where the camera was refused, infinite where one was
    given that sees a correspondence point above its horizon.
    """
    if not found or found.camera is None:
        return float("nan")
    try:
        return reference.score(found.camera).mean_m
    except InputError:
        return float("inf")


@dataclass(frozen=True, eq=False)
class FewPeople:
    """Draws (d,) of so many people from single frames, each calibrated twice.

    ``alone_m`` are the errors (:func:`few_error_m`) by the people alone, ``guided_m`` those with
    what the orientation network reads in the same frame. The draws of a recording share its scene
    and its camera: they are not independent.
    """

    footage: str
    people: int
    alone_m: Float[np.ndarray, "d"]
    guided_m: Float[np.ndarray, "d"]

    @property
    def draws(self) -> int:
        """How many times people were drawn."""
        return len(self.alone_m)

    @property
    def both(self) -> int:
        """Draws for which both gave a camera."""
        return int(self._both.sum())

    @property
    def closer(self) -> int:
        """Of :attr:`both`, those in which the guess made the error smaller."""
        return int((self.guided_m < self.alone_m)[self._both].sum())

    @property
    def _both(self) -> np.ndarray:
        return ~(np.isnan(self.alone_m) | np.isnan(self.guided_m))

    def to_dict(self) -> dict[str, Any]:
        """One row of ``evaluation.json``. Medians are over the cameras that were given, None where
        there is none or the middle one has failed; ``where_both`` compares like with like.
        """
        where = self._both
        return {
            "footage": self.footage,
            "method": "joint",
            "people": self.people,
            "draws": self.draws,
            "nothing": _summary(self.alone_m),
            "network": _summary(self.guided_m),
            "where_both": {
                "draws": self.both,
                "nothing_median_m": median_m(self.alone_m[where]),
                "network_median_m": median_m(self.guided_m[where]),
                "network_closer": self.closer,
            },
        }


def median_m(errors_m: Float[np.ndarray, "d"]) -> float | None:
    """Median of the cameras that were given; None where none was, or the middle one has failed."""
    given = errors_m[~np.isnan(errors_m)]
    # The middle one, or the better of the two: no mean of a number and infinity.
    middle = float(np.sort(given)[(len(given) - 1) // 2]) if len(given) else float("inf")
    return middle if np.isfinite(middle) else None


def _summary(errors_m: np.ndarray) -> dict[str, Any]:
    return {
        "refused": int(np.isnan(errors_m).sum()),
        "failed": int(np.isinf(errors_m).sum()),
        "median_m": median_m(errors_m),
    }
