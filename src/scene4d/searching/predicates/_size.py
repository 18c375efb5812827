"""How large something is: from the size of its track, which is known ever better."""

import numpy as np
from jaxtyping import Float

from scene4d.searching.predicates._gaussian import ndtr
from scene4d.searching.predicates.stage import StageRows

_LENGTH, _HEIGHT = 0, 2


def longer_than(a: StageRows, *, length_m: float = 6.0) -> Float[np.ndarray, "m"]:
    """P(the vehicle a is longer than ``length_m``): ``Φ((l - length_m) / σ_l)``. The default
    divides cars from lorries and buses. NaN where no length is known, as of people.
    """
    return _exceeds(a, _LENGTH, length_m)


def taller_than(a: StageRows, *, height_m: float = 1.5) -> Float[np.ndarray, "m"]:
    """P(a is taller than ``height_m``): ``Φ((h - height_m) / σ_h)``, of people and vehicles. The
    default divides grown-ups from children below about 12. NaN where no height is known.
    """
    return _exceeds(a, _HEIGHT, height_m)


def _exceeds(a: StageRows, axis: int, limit_m: float) -> Float[np.ndarray, "m"]:
    over, sigma = a.size_m[:, axis] - limit_m, a.size_sigma_m[:, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        found: np.ndarray = ndtr(over / sigma)
    return found
