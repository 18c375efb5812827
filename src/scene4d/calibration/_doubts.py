"""What speaks against a camera although it is well determined: no ground, or two cameras."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import FOCAL, TILT
from scene4d.calibration._case import Case
from scene4d.calibration._evidence import evidence
from scene4d.calibration._problem import Problem, State
from scene4d.calibration._rivals import Rival, find_rival
from scene4d.calibration._verdict import FOCAL_KNOWN

_SURE = float(np.log(100.0))
"""Log odds, on people held out, from which one explanation is believed. Where :data:`_MOST` agree,
the camera stands unless "people of any size anywhere" is so much better; where fewer do, it must be
so much better itself. """
_MOST = 0.65
_TWO_CAMERAS = 0.25
"""Share of people who agree on another camera from which nobody can say which is the footage's."""
_SCREEN_AREA = 0.1
"""Share of the picture that all people keep to, from which it may be a screen. Ten tracks of any
recording spread over 0.16 or more."""
_MANY = 10
"""So many different people do not all walk in one small place by chance."""
_RIMS = (0.02, 0.98)
"""Quantiles that bound where people are; beyond them are false detections."""


@dataclass(frozen=True)
class Doubts:
    """Why a determined camera is refused all the same (or None), and warnings."""

    refusal: str | None = None
    warnings: tuple[str, ...] = ()


def doubts(case: Case, problem: Problem, state: State, people: int, agreeing: float) -> Doubts:
    """What speaks against the camera ``state``, on which a share of the sightings agrees, of so
    many different ``people``.
    """
    rival = find_rival(problem, state, seed=case.asked.seed)
    if rival is not None:
        return _about(rival, case)
    # Without a focal length, people of any size leave it undetermined, which was refused before.
    asked = case.asked.systematics or problem.prior.sigma[FOCAL] <= FOCAL_KNOWN
    needed = -_SURE if agreeing > _MOST else _SURE
    if asked and evidence(problem, state) < needed:
        return Doubts(
            "the people's sizes follow no ground: those held out are predicted better by "
            '"any size anywhere" than by the others\' camera; needed: footage of one fixed camera '
            "in which people walk nearer and farther on flat ground"
        )
    where = _where(case, np.arange(len(problem.track)))
    share = np.prod((where[1] - where[0]) / case.frame.image_size)
    if people >= _MANY and share < _SCREEN_AREA:
        return _in_one_part(case, where)
    return Doubts()


def _in_one_part(case: Case, where: np.ndarray) -> Doubts:
    text = (
        f"all people keep to a small part of the picture, {_words(where)}, which may be a screen "
        "or a mirror"
    )
    if case.frame.lens is None:  # on a screen, neither focal length nor middle are the picture's
        return Doubts(
            f"{text}; needed: footage in which people walk elsewhere too, or a lens file (lens) if "
            "they really keep to that part"
        )
    return Doubts(
        warnings=(f"{text[0].upper()}{text[1:]}: then this is not the footage's camera.",)
    )


def _about(rival: Rival, case: Case) -> Doubts:
    focal_px = np.exp(rival.parameters[FOCAL]) * case.frame.half_diagonal_px
    text = (
        f"{rival.share:.0%} of the people, {_words(_where(case, rival.rows))}, contradict the "
        f"others and agree on another camera (focal length {focal_px:.0f} px, tilt "
        f"{np.degrees(rival.parameters[TILT]):.0f}°)"
    )
    if rival.share >= _TWO_CAMERAS:
        return Doubts(
            f"{text}; needed: footage of one camera, without a screen, a mirror or a second view "
            "in the picture (cover that part)"
        )
    return Doubts(warnings=(f"{text}: a screen, a mirror or a second view? They were left out.",))


def _where(case: Case, rows: np.ndarray) -> Float[np.ndarray, "2 2"]:
    """Corners of the part of the footage (px) in which the usable people ``rows`` are."""
    seen = case.segments.select(case.usable).select(rows)
    return np.quantile(np.concatenate([seen.foot_uv, seen.head_uv]), _RIMS, axis=0)


def _words(where: np.ndarray) -> str:
    (left, top), (right, bottom) = where
    return f"within columns {left:.0f} to {right:.0f} and rows {top:.0f} to {bottom:.0f}"
