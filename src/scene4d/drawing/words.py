"""Numbers with their uncertainty, and the verdict, in plain words."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.drawing._uncertainty import Z95, field_of_view, propagated

_MINUS = "−"


@dataclass(frozen=True)
class Row:
    """One line of the parameter table."""

    name: str
    value: str
    interval: str
    meaning: str


def _decimals(sigma: float) -> int:
    """Decimal places that show ``sigma`` with one digit, or two when the first is 1."""
    if not (np.isfinite(sigma) and sigma > 0):
        return 2
    exponent = int(np.floor(np.log10(sigma)))
    first = round(sigma / 10.0**exponent, 6)
    return max(0, -exponent + (first < 2))


def number(value: float, places: int) -> str:
    """Fixed-point text with a true minus sign, never ``-0``; thin spaces from 10 000 on."""
    text = f"{abs(value):,.{places}f}".replace(",", "\u202f" if abs(value) >= 1e4 else "")
    negative = value < 0 and float(f"{abs(value):.{places}f}") != 0
    return (_MINUS if negative else "") + text


def plus_minus(value: float, sigma: float | None, unit: str, places: int = 2) -> str:
    """``7.07 ± 0.14 m``: as many digits as ``sigma`` justifies; ``places`` if it is unknown."""
    gap = "" if unit == "°" else "\u00a0"
    if sigma is None or not np.isfinite(sigma):
        return f"{number(value, places)}{gap}{unit}"
    if sigma == 0:
        return f"{number(value, places)}{gap}{unit} (given)"
    n = _decimals(sigma)
    if unit == "°":
        return f"{number(value, n)}° ± {number(sigma, n)}°"
    return f"{number(value, n)} ± {number(sigma, n)}{gap}{unit}".rstrip("\u00a0")


def verdict(calibration: Calibration) -> str:
    """The result in one sentence."""
    camera = calibration.camera
    if not calibration or camera is None:
        reason = (calibration.reason or "no reason was recorded").strip().rstrip(".")
        return f"No camera found: {reason}."
    sigma = calibration.sigma
    tilt = float(np.degrees(camera.tilt_rad))
    look = "down" if tilt >= 0 else "up"
    height = plus_minus(camera.height_m, sigma.get("height_m"), "m")
    angle = plus_minus(abs(tilt), sigma.get("tilt_deg"), "°")
    text = f"Camera found: {height} above the ground, looking {angle} {look}"
    errors = ground_error_texts(calibration)
    if not errors:
        return text + "."
    medians = [f"{error.median} {error.name}" for error in errors]
    return (
        f"{text}; positions on the ground are good to about {' and '.join(medians)} "
        f"(medians over {errors[0].over})."
    )


@dataclass(frozen=True)
class ErrorText:
    """A predicted error on the ground: median and 90th percentile, over what they are taken, and
    the median where people walked, empty where unknown.
    """

    name: str
    median: str
    p90: str
    over: str
    walked: str


def ground_error_texts(calibration: Calibration) -> list[ErrorText]:
    """The two predicted ground errors. Unknown errors are left out.

    *Within the scene* is the error of positions relative to each other: a shift or rotation of the
    whole scene does not count. *From the camera* counts it: it is the error of a distance to the
    camera.
    """
    rows = (
        ("within the scene", calibration.ground_error_m),
        ("from the camera", calibration.ground_error_from_camera_m),
    )
    return [
        _error_text(name, error)
        for name, error in rows
        if error is not None and np.isfinite([error["median"], error["p90"]]).all()
    ]


def _error_text(name: str, error: dict[str, float]) -> ErrorText:
    over, walked = "the places where people walked", ""
    if "out_to_m" in error:
        over = f"the ground in view, out to {number(error['out_to_m'], 0)}\u00a0m"
        walked = rounded_m(error["walked_median"])
    return ErrorText(name, rounded_m(error["median"]), rounded_m(error["p90"]), over, walked)


def rounded_m(metres: float) -> str:
    """Metres with a sensible number of digits: ``0.36 m``, ``4.2 m``, ``31 m``."""
    places = 2 if metres < 0.995 else 1 if metres < 9.95 else 0
    return f"{number(metres, places)}\u00a0m"


def k1_sigma(camera: Camera, covariance: Float[np.ndarray, "p p"]) -> float:
    """Standard deviation of k1, propagated from the focal length and the corner's displacement.

    With D the displacement, ``k1 = D (f / half diagonal)²``: see ``model.PARAMETERS``.
    """
    k1 = float(camera.distortion[0])
    by_corner = float((2 * camera.K[0, 0] / np.hypot(*camera.image_size)) ** 2)
    gradient = np.array([2 * k1, 0.0, 0.0, 0.0, by_corner])
    return float(np.sqrt(gradient @ covariance[:5, :5] @ gradient)) if covariance[4, 4] > 0 else 0.0


def parameter_rows(calibration: Calibration) -> list[Row]:
    """The parameter table: value ± one standard deviation, and the 95 % interval."""
    camera = calibration.camera
    if camera is None:
        return []
    s, C = calibration.sigma, calibration.covariance
    tilt, roll = float(np.degrees(camera.tilt_rad)), float(np.degrees(camera.roll_rad))
    rows = [
        _log_row("Height", camera.height_m, s.get("height_m"), "m", "camera above the ground"),
        _row("Tilt", tilt, s.get("tilt_deg"), "°", "angle of the optical axis below the horizon"),
        _row("Roll", roll, s.get("roll_deg"), "°", "positive: the horizon falls to the right"),
        _log_row("Focal length", camera.focal_px, s.get("focal_px"), "px", "in footage pixels", 0),
    ]
    rows += _view_rows(camera, C)
    return rows + _centre_rows(camera, s) + _lens_rows(camera, C)


def _centre_rows(camera: Camera, sigma: dict[str, float]) -> list[Row]:
    """The principal point: with its error where it was estimated, else where it is from."""
    width, height = camera.image_size
    u, v = (float(x) for x in camera.K[:2, 2])
    off = u - (width - 1) / 2, v - (height - 1) / 2
    across, down = sigma.get("principal_u_px", 0.0), sigma.get("principal_v_px", 0.0)
    if not across and not down:
        middle = bool(np.abs(off).max() < 0.5)
        meaning = "the picture's middle, not estimated" if middle else "from the lens file"
        return [Row("Principal point", f"{number(u, 0)}, {number(v, 0)}\u00a0px", "", meaning)]
    sides = (("left of", "right of"), ("above", "below"))
    words = [
        f"{number(abs(x), 0)}\u00a0px {side[x > 0]} the picture's middle"
        for x, side in zip(off, sides, strict=True)
    ]
    return [
        _row("Principal point, across", u, across, "px", words[0], 0),
        _row("Principal point, down", v, down, "px", words[1], 0),
    ]


def _lens_rows(camera: Camera, covariance: np.ndarray | None) -> list[Row]:
    if not camera.bends:
        return []
    sigma = None if covariance is None else k1_sigma(camera, covariance)
    meaning = "radial coefficient k₁; negative is barrel distortion"
    names, model = "k2 p1 p2 k3", ""
    if camera.is_fisheye:
        meaning = "coefficient k₁ of OpenCV's fisheye model"
        names, model = "k2 k3 k4", "fisheye "
    rows = [_row("Distortion", float(camera.distortion[0]), sigma, "", meaning, 3)]
    rest = ", ".join(
        f"{n} = {number(float(x), 4)}"
        for n, x in zip(names.split(), camera.distortion[1:], strict=True)
        if x
    )
    if rest:
        rows.append(Row("Further coefficients", rest, "", f"OpenCV's {model}lens model"))
    return rows


def _view_rows(camera: Camera, covariance: np.ndarray | None) -> list[Row]:
    value = np.degrees(field_of_view(camera))
    sigma: list[float | None] = [None, None]
    if covariance is not None:
        sigma = [float(x) for x in np.degrees(propagated(camera, covariance, field_of_view))]
    names = ("Field of view, horizontal", "Field of view, vertical")
    meanings = ("angle across the frame's middle row", "angle down the frame's middle column")
    return [
        _row(name, float(x), s, "°", meaning, 1)
        for name, x, s, meaning in zip(names, value, sigma, meanings, strict=True)
        if np.isfinite(x)
    ]


def _row(
    name: str, value: float, sigma: float | None, unit: str, meaning: str, places: int = 2
) -> Row:
    interval = ""
    if sigma is not None and np.isfinite(sigma) and sigma > 0:
        interval = _interval(value - Z95 * sigma, value + Z95 * sigma, sigma, unit)
    return Row(name, plus_minus(value, sigma, unit, places), interval, meaning)


def _log_row(
    name: str, value: float, sigma: float | None, unit: str, meaning: str, places: int = 2
) -> Row:
    """A positive quantity with a Gaussian logarithm: its interval is not symmetric."""
    interval = ""
    if sigma is not None and np.isfinite(sigma) and sigma > 0:
        factor = float(np.exp(Z95 * sigma / value))
        interval = _interval(value / factor, value * factor, sigma, unit)
    return Row(name, plus_minus(value, sigma, unit, places), interval, meaning)


def _interval(low: float, high: float, sigma: float, unit: str) -> str:
    n = _decimals(sigma)
    gap = "" if unit == "°" else "\u00a0"
    return f"{number(low, n)} to {number(high, n)}{gap}{unit}".rstrip("\u00a0")
