"""How large something is and what colour it has: by its whole track, which is known ever better."""

import numpy as np
from jaxtyping import Float

from scene4d.core.colours import colour_probability
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


def coloured(a: StageRows, *, colour: str, part: str = "upper") -> Float[np.ndarray, "m"]:
    """P(a has this ``colour``): a basic colour term, "dark", "light", or both ("dark blue"). Of
    people that of the clothes of the ``part`` "upper" or "lower" body, of vehicles ("upper") the
    body's. What the last row of the track knows counts in all its rows. Where nothing was seen of
    it, it is as probable as the colour is common.
    """
    tracks, stage = a.stage.tracks, a.stage
    last = stage.last_row[stage.track_of_row[a.index]]
    people = tracks.class_name[last] == "person"
    return colour_probability(tracks.colours[last].astype(float), colour, part, people)
