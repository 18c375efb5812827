"""Colours of clothes and vehicles by name, as probabilities.

What a picture shows of a colour is compared with a palette: the eleven basic colour terms (Berlin
and Kay, "Basic Color Terms", 1969), most of them also dark and light. Every entry is one or more
normal distributions in CIELAB: how much things of that name differ, and what a camera adds to all
it shows (shade, exposure, saturation, a cast that white balance left).
"""

import numpy as np
from jaxtyping import Bool, Float

NAMES: tuple[str, ...] = (
    *("black", "white", "grey", "red", "orange", "yellow", "green", "blue", "brown", "purple"),
    "pink",
)
"""The basic colour terms."""
SHADES: tuple[str, ...] = ("dark", "light")
PARTS: tuple[str, ...] = ("upper", "lower")
"""Upper body (or the whole of a vehicle) and lower body."""

# Name, share of it, and L*, chroma and hue (degrees) of things: fabrics and car paint are less
# saturated than colours on screens, of which the XKCD colour survey (2010) names 600 by these
# words; hues and the order of lightness are its medians, chroma about 0.7 of them.
_MIDDLES: tuple[tuple[str, float, float, float, float], ...] = (
    ("black", 1.0, 14, 2, 270),
    ("dark grey", 1.0, 34, 3, 260),
    ("grey", 1.0, 53, 4, 260),
    ("light grey", 1.0, 72, 4, 260),
    ("white", 1.0, 90, 4, 100),
    ("dark red", 1.0, 26, 36, 22),
    ("red", 1.0, 44, 56, 27),
    ("orange", 1.0, 60, 62, 57),
    ("yellow", 0.7, 80, 62, 92),
    ("yellow", 0.3, 88, 38, 98),
    ("dark green", 0.6, 27, 20, 145),
    ("dark green", 0.4, 36, 24, 112),
    ("green", 0.6, 49, 40, 140),
    ("green", 0.4, 49, 28, 185),
    ("light green", 1.0, 76, 36, 130),
    ("dark blue", 0.6, 20, 20, 282),
    ("dark blue", 0.4, 28, 15, 268),
    ("blue", 0.4, 45, 38, 275),
    ("blue", 0.3, 38, 58, 293),
    ("blue", 0.3, 51, 26, 250),
    ("light blue", 1.0, 72, 22, 250),
    ("dark brown", 1.0, 26, 13, 58),
    ("brown", 1.0, 44, 26, 66),
    ("light brown", 1.0, 70, 20, 82),
    ("dark purple", 1.0, 25, 24, 320),
    ("purple", 1.0, 43, 40, 318),
    ("light purple", 1.0, 68, 25, 312),
    ("pink", 1.0, 60, 42, 2),
    ("light pink", 1.0, 79, 20, 5),
)
PALETTE: tuple[str, ...] = tuple(dict.fromkeys(name for name, *_ in _MIDDLES))
"""What is told apart: names with their shades. Black is dark and white light without saying so."""

# How common they are: of clothes guessed by hand for streets and rooms, of vehicles as the yearly
# popularity reports of paint makers have it (white 35 %, black 20 %, grey and silver 25 %, blue
# 9 %, red 5 %), widened for lorries and buses.
_CLOTHES = {
    **{"black": 0.22, "dark grey": 0.09, "grey": 0.07, "light grey": 0.05, "white": 0.11},
    **{"dark red": 0.03, "red": 0.05, "orange": 0.015, "yellow": 0.02},
    **{"dark green": 0.03, "green": 0.02, "light green": 0.01},
    **{"dark blue": 0.11, "blue": 0.05, "light blue": 0.04},
    **{"dark brown": 0.03, "brown": 0.02, "light brown": 0.035},
    **{
        "dark purple": 0.01,
        "purple": 0.01,
        "light purple": 0.01,
        "pink": 0.015,
        "light pink": 0.02,
    },
}
_VEHICLES = {
    **{"black": 0.16, "dark grey": 0.12, "grey": 0.11, "light grey": 0.1, "white": 0.24},
    **{"dark red": 0.025, "red": 0.05, "orange": 0.01, "yellow": 0.015},
    **{"dark green": 0.015, "green": 0.01, "light green": 0.005},
    **{"dark blue": 0.05, "blue": 0.04, "light blue": 0.015},
    **{"dark brown": 0.01, "brown": 0.01, "light brown": 0.02},
    **{"dark purple": 0.003, "purple": 0.003, "light purple": 0.002},
    **{"pink": 0.002, "light pink": 0.002},
}


def _prior(share: dict[str, float]) -> Float[np.ndarray, "k"]:
    values = np.array([share[name] for name in PALETTE])
    return values / values.sum()


CLOTHES, VEHICLES = _prior(_CLOTHES), _prior(_VEHICLES)
"""How probable each entry is of clothes, and of vehicles, before anything is seen."""

_OWN_L, _OWN_AB, _OWN_CHROMA = 7.0, 2.5, 0.2
"""How much things of one name differ: in lightness, and in a* and b* (more the more saturated)."""
_SHADE, _SATURATION, _CAST = 0.18, 0.2, 0.045
"""What the picture adds to all looks at a thing alike. Light and shade change linear values by a
half (0.18 of the cube root, to which L* + 16 and a*, b* are proportional); cameras show colours by
a fifth more or less saturated; after white balance a cast of 13 % in a channel is left."""
_STRAY_L, _STRAY_AB = 4.0, 2.0
"""Stray light, compression and what else is there in any picture."""
_WRONG, _ROOM = 0.1, 8.2e5
"""Share of looks at something else (a bag, an arm, who stands before), and the volume of all
colours of sRGB in CIELAB, anywhere in which that may lie."""


def _normals() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Entry and log share of each normal distribution, its mean and its covariance."""
    entry = np.array([PALETTE.index(name) for name, *_ in _MIDDLES])
    share, light, chroma, hue = np.array([one[1:] for one in _MIDDLES], float).T
    ab = chroma[:, None] * np.column_stack([np.cos(np.radians(hue)), np.sin(np.radians(hue))])
    mean = np.column_stack([light, ab])
    shade = _SHADE * np.column_stack([light + 16, ab])
    saturation = _SATURATION * np.column_stack([0 * light, ab])
    alone = np.zeros((len(mean), 3))
    alone[:, 0] = _OWN_L**2 + _STRAY_L**2
    cast = _CAST * (light + 16)
    alone[:, 1:] = ((_OWN_AB + _OWN_CHROMA * chroma) ** 2 + _STRAY_AB**2 + cast**2)[:, None]
    covariance = alone[:, :, None] * np.eye(3)
    for way in (shade, saturation):
        covariance = covariance + way[:, :, None] * way[:, None, :]
    return entry, np.log(share), mean, covariance


_ENTRY, _LOG_SHARE, _MEAN, _COVARIANCE = _normals()
_IS_ENTRY = (_ENTRY[:, None] == np.arange(len(PALETTE))).astype(float)


def log_likelihood(
    lab: Float[np.ndarray, "n 3"], sigma: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n k"]:
    """Of one look, for each entry of :data:`PALETTE`: what is seen, in CIELAB (D65), and how far it
    may be off beside what all pictures are (standard deviation along each axis).
    """
    wide = _COVARIANCE + (sigma**2)[:, None, None, None] * np.eye(3)
    away = lab[:, None] - _MEAN
    q = np.einsum("nji,nji->nj", away, np.linalg.solve(wide, away[..., None])[..., 0])
    log = _LOG_SHARE - (q + np.linalg.slogdet(wide)[1] + 3 * np.log(2 * np.pi)) / 2
    return np.asarray(np.log((1 - _WRONG) * (np.exp(log) @ _IS_ENTRY) + _WRONG / _ROOM))


def members(colour: str) -> Bool[np.ndarray, "k"]:
    """The entries that a colour means: "red" all reds, "dark" all that is dark, "dark red" one.

    Raises :class:`KeyError` for what is no colour (:func:`is_colour`).
    """
    shade, _, name = colour.rpartition(" ")
    if not shade and colour in SHADES:
        also = {"dark": "black", "light": "white"}[colour]
        return np.array([one.startswith(colour) or one == also for one in PALETTE])
    if shade == {"black": "dark", "white": "light"}.get(name):
        shade = ""
    found = np.array([one.split()[-1] == name and one.startswith(shade) for one in PALETTE])
    if not found.any():
        raise KeyError(colour)
    return found


def is_colour(text: str) -> bool:
    """Whether :func:`members` knows it."""
    try:
        members(text)
    except KeyError:
        return False
    return True


def colour_probability(
    colours: Float[np.ndarray, "n c"], colour: str, part: str, clothes: Bool[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """P(a part has a colour) of rows of ``Tracks.colours``: where nothing was seen of it, how
    common the colour is, of ``clothes`` or else of vehicles.
    """
    chosen = members(colour)
    common = np.where(clothes, CLOTHES[chosen].sum(), VEHICLES[chosen].sum())
    if not colours.shape[1]:
        return common
    half = colours.reshape(-1, len(PARTS), len(PALETTE))[:, PARTS.index(part)]
    seen = half.sum(axis=1) > 0
    return np.where(seen, half[:, chosen].sum(axis=1), common)
