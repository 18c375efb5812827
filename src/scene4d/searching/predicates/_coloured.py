"""What colour clothes and vehicles have: from the looks at the whole track."""

import numpy as np
from jaxtyping import Float

from scene4d.core.colours import colour_probability
from scene4d.searching.predicates.stage import StageRows


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
