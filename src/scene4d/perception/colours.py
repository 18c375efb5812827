"""Reads the colours of clothes and vehicles in frames, a few times a second.

A reading is the middle (median) of some forty points of a part: between shoulders and hips, of the
thighs, of a vehicle's body below its windows. Points that somebody nearer covers are left out. The
picture is first corrected for its light: its colour by the grey-edge hypothesis (van de Weijer,
Gevers, Gijsenij, "Edge-Based Color Constancy", IEEE Transactions on Image Processing, 2007), its
brightness by what is brightest in it.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from scene4d.core.people import Detections

COLUMNS = 8
"""L*, a*, b* and their standard deviation, of the upper part and of the lower."""
_EVERY_S = 0.4
"""Time between readings: looks nearer to each other show the same; the keypoints are not newer."""
_LIGHT_S = 2.0
"""Time between looks at the light, to which cameras adapt in seconds."""
_EARLY_S = 1e-3  # times carry rounding errors
_LIGHT_PX = 160
"""Width of the picture from which the light is read."""
_NORM = 6
"""Minkowski norm of the edges, as in the paper's best results."""
_TRUST = 0.4
"""Share of the seen cast that is taken off: cameras balance white already, to some 8 %, and the
estimate errs by some 10 % (5 degrees): 0.08² / (0.08² + 0.1²)."""
_BRIGHT, _BRIGHT_QUANTILE = 0.8, 0.97
"""Linear value that the brightest things of a scene are taken to have; half of the difference (as a
power) is taken off, since many scenes hold nothing white. Chosen."""
_LEAST_BRIGHT = 0.02
"""Below it is night, and colours are noise. Chosen."""
_LEAST_CHROMA = 4.0
"""Infrared and grey pictures: where 95 % of the picture have less chroma, none is a colour's."""
_SURE = 0.3
"""Score from which a keypoint is believed."""
_LEAST_SHOWN = 0.5
"""Share of the points that must be seen."""
_LEAST_PX = 2.5
"""Width of a part below which it is its surroundings as well: chroma has half the pixels."""
_BLEED = 6.0
"""Standard deviation of what surroundings add where a part is four pixels wide. Chosen."""
_SPREAD_SHARE = 0.5
"""How far the middle may be off, in spreads of the points: patterns, folds, two things in one."""

_FRAMES = ("bicycle", "motorcycle")
"""Boxes of these show riders and what is behind."""
_SHOULDERS, _HIPS, _KNEES = (5, 6), (11, 12), (13, 14)
_DOWN, _ACROSS = np.linspace(0.1, 0.85, 8), np.linspace(-1, 1, 5)
_THIGH, _BESIDE = np.linspace(0.3, 1.0, 7), np.linspace(-1, 1, 3)
_HALF_WIDTH = {"chest": 0.3, "thin": 0.12, "thigh": 0.07}
"""Half the width that is read: of the distance of the shoulders; in trunk lengths if seen from the
side; of a thigh, in trunk lengths. Less than bodies have, for arms and the ground beside."""
_BOXES = {"upper": (0.2, 0.45, 0.15), "lower": (0.55, 0.75, 0.12), "vehicle": (0.5, 0.72, 0.3)}
"""From where to where in the box's height, and half the width in its width, without keypoints."""

_LINEAR = np.where(
    np.arange(256) / 255 <= 0.04045,
    np.arange(256) / 255 / 12.92,
    ((np.arange(256) / 255 + 0.055) / 1.055) ** 2.4,
)
_XYZ_OF_BGR = np.array(
    [[0.1805, 0.3576, 0.4124], [0.0722, 0.7152, 0.2126], [0.9505, 0.1192, 0.0193]]
) / np.array([[0.95047], [1.0], [1.08883]])
"""sRGB (IEC 61966-2-1) to XYZ, in shares of the white D65."""


class ColourReader:
    """Reads colours where they are due; frames must come in order of time."""

    def __init__(self) -> None:
        self._read_s = self._light_s = -np.inf
        self._gain: np.ndarray | None = None

    def read(
        self, image_bgr: UInt8[np.ndarray, "h w 3"], time_s: float, seen: Detections
    ) -> Float32[np.ndarray, "n 8"]:
        """Readings of what is seen in a frame; NaN where nothing is read."""
        out = np.full((len(seen), COLUMNS), np.nan, np.float32)
        if not len(seen) or time_s - self._read_s < _EVERY_S - _EARLY_S:
            return out
        self._read_s = time_s
        if time_s - self._light_s >= _LIGHT_S - _EARLY_S:
            self._light_s, self._gain = time_s, light_gain(image_bgr)
        if self._gain is not None:
            out[:, :4], out[:, 4:] = (_readings(image_bgr, self._gain, seen, p) for p in (0, 1))
        return out


def light_gain(image_bgr: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "3"] | None:
    """Factors of linear B, G, R that take off the light of a scene; None at night and where the
    picture has no colours.
    """
    step = max(1, image_bgr.shape[1] // _LIGHT_PX)
    linear = _LINEAR[image_bgr[::step, ::step]]
    bright = float(np.quantile(linear.mean(axis=2), _BRIGHT_QUANTILE))
    if bright < _LEAST_BRIGHT:
        return None
    chroma = np.linalg.norm(to_lab(linear.reshape(-1, 3))[:, 1:], axis=1)
    if np.quantile(chroma, 0.95) < _LEAST_CHROMA:
        return None
    edges = [np.abs(np.diff(linear, axis=axis)).reshape(-1, 3) for axis in (0, 1)]
    norm = (np.concatenate(edges) ** _NORM).mean(axis=0) ** (1 / _NORM)
    cast = np.log(np.maximum(norm, 1e-6))
    gain: np.ndarray = np.exp(-_TRUST * (cast - cast.mean())) * np.sqrt(_BRIGHT / bright)
    return gain


def to_lab(linear_bgr: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """CIELAB (D65) of linear B, G, R from 0 to 1."""
    xyz = np.maximum(linear_bgr, 0.0) @ _XYZ_OF_BGR.T
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def _readings(
    image: np.ndarray, gain: np.ndarray, seen: Detections, part: int
) -> Float[np.ndarray, "n 4"]:
    """Of one part of everybody; vehicles have but the upper."""
    points, width_px = _lower(seen) if part else _upper(seen)
    height, width = image.shape[:2]
    u, v = (np.rint(np.nan_to_num(points[..., axis], nan=-1.0)).astype(int) for axis in (0, 1))
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    shown = np.asarray(inside & ~_covered(points, seen))
    good = (shown.mean(axis=1) >= _LEAST_SHOWN) & (width_px >= _LEAST_PX)
    out = np.full((len(seen), 4), np.nan)
    if not good.any():
        return out
    u, v, shown = u[good].clip(0, width - 1), v[good].clip(0, height - 1), shown[good]
    lab = np.where(shown[..., None], to_lab(_LINEAR[image[v, u]] * gain), np.nan)
    middle = np.nanmedian(lab, axis=1)
    spread = 1.4826 * np.nanmedian(np.abs(lab - middle[:, None]), axis=1)
    off = np.hypot(_SPREAD_SHARE * spread.mean(axis=1), _BLEED * 4 / width_px[good])
    out[good] = np.column_stack([middle, off])
    return out


def _covered(points: Float[np.ndarray, "n m 2"], seen: Detections) -> Bool[np.ndarray, "n m"]:
    """Points that lie in the box of somebody nearer, whose lower edge is lower."""
    box = seen.box_xyxy
    at = points[:, :, None]
    inside = np.asarray(((at > box[:, :2]) & (at < box[:, 2:])).all(axis=-1))
    nearer = box[None, :, 3] > box[:, None, 3]
    return np.asarray((inside & nearer[:, None]).any(axis=2))


def _upper(seen: Detections) -> tuple[Float[np.ndarray, "n m 2"], Float[np.ndarray, "n"]]:
    """Points of chests, and of vehicles' bodies; and how wide (px) what they lie in is."""
    vehicle = seen.class_name != "person"
    points, half = _in_box(seen.box_xyxy, "upper", _DOWN, _ACROSS)
    on_vehicle, half_vehicle = _in_box(seen.box_xyxy, "vehicle", _DOWN, _ACROSS)
    points[vehicle], half[vehicle] = on_vehicle[vehicle], half_vehicle[vehicle]
    half[np.isin(seen.class_name, _FRAMES)] = 0.0
    skeleton, sure = _skeleton(seen)
    if not skeleton.any():
        return points, 2 * half
    left, right = (seen.keypoint_uv[:, k] for k in _SHOULDERS)
    top, bottom = (left + right) / 2, seen.keypoint_uv[:, _HIPS].mean(axis=1)
    trunk = np.linalg.norm(bottom - top, axis=1)
    wide = np.maximum(
        _HALF_WIDTH["chest"] * np.abs(left - right)[:, 0], _HALF_WIDTH["thin"] * trunk
    )
    on_body = _along(top, bottom, wide, _DOWN, _ACROSS)
    known = sure[:, [*_SHOULDERS, *_HIPS]].all(axis=1)
    points[skeleton], half[skeleton] = on_body[skeleton], wide[skeleton]
    half[skeleton & ~known] = 0.0
    return points, 2 * half


def _lower(seen: Detections) -> tuple[Float[np.ndarray, "n m 2"], Float[np.ndarray, "n"]]:
    """Points of thighs, or of people's boxes; nothing of vehicles."""
    points, half = _in_box(seen.box_xyxy, "lower", _THIGH, np.linspace(-1, 1, 6))
    skeleton, sure = _skeleton(seen)
    if skeleton.any():
        trunk = seen.keypoint_uv[:, _SHOULDERS].mean(axis=1)
        trunk = np.linalg.norm(seen.keypoint_uv[:, _HIPS].mean(axis=1) - trunk, axis=1)
        wide = _HALF_WIDTH["thigh"] * trunk
        legs = [
            _along(seen.keypoint_uv[:, hip], seen.keypoint_uv[:, knee], wide, _THIGH, _BESIDE)
            for hip, knee in zip(_HIPS, _KNEES, strict=True)
        ]
        known = sure[:, [*_HIPS, *_KNEES]].all(axis=1)
        points[skeleton] = np.concatenate(legs, axis=1)[skeleton]
        half[skeleton] = 2 * wide[skeleton]  # of two legs side by side
        half[skeleton & ~known] = 0.0
    half[seen.class_name != "person"] = 0.0
    return points, 2 * half


def _skeleton(seen: Detections) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n k"]]:
    """Who has a skeleton (small people have none that is believed), and which keypoints are."""
    n = len(seen)
    if len(seen.keypoint_names) <= max(_KNEES):
        return np.zeros(n, bool), np.zeros((n, 0), bool)
    sure = (seen.keypoint_score >= _SURE) & np.isfinite(seen.keypoint_uv).all(axis=2)
    return sure[:, [*_SHOULDERS, *_HIPS, *_KNEES]].any(axis=1), sure


def _in_box(
    box: Float[np.ndarray, "n 4"], what: str, along: np.ndarray, across: np.ndarray
) -> tuple[Float[np.ndarray, "n m 2"], Float[np.ndarray, "n"]]:
    begin, end, wide = _BOXES[what]
    middle, height = (box[:, 0] + box[:, 2]) / 2, box[:, 3] - box[:, 1]
    top, bottom = (np.column_stack([middle, box[:, 1] + at * height]) for at in (begin, end))
    half = wide * (box[:, 2] - box[:, 0])
    return _along(top, bottom, half, along, across), half


def _along(
    top: np.ndarray, bottom: np.ndarray, half: np.ndarray, along: np.ndarray, across: np.ndarray
) -> Float[np.ndarray, "n m 2"]:
    """Points beside a line: shares of its length, by shares of half a width to both sides."""
    line = top[:, None] + along[:, None] * (bottom - top)[:, None]
    points = np.repeat(line[:, :, None], len(across), axis=2)
    points[..., 0] += (half[:, None] * across)[:, None]
    return points.reshape(len(top), -1, 2)
