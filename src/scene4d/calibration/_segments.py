"""From detections to the upright segments that a camera is calibrated from."""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import BORDER_PX, HEAD_TOP, LEFT_FOOT, MIN_KEYPOINT_SCORE, RIGHT_FOOT
from scene4d.core.people import Detections, Segments

MIN_LENGTH_PX = 15.0
"""Shorter people carry more noise than news."""

_LEAST_FOR_NADIR, _MOST_FOR_NADIR = 10, 500
"""Fewer people do not show whether the picture contains the point below the camera; more are not
needed to see it."""
_LEAST_ORDINARY = 0.4
"""Share of heads above the feet in the picture below which the camera rather hangs upside down."""
_AWAY_RAD = 0.4
"""How far from straight away a body may lie: leaning, and half a step of the grid of nadirs."""

_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
_NEEDED = (HEAD_TOP, *LEFT_FOOT, *RIGHT_FOOT, *_TRUNK)


def missing_keypoints(detections: Detections) -> list[str]:
    """Names of the keypoints that segments need and these detections, which have some, lack."""
    if not detections.keypoint_names:
        return []
    return sorted(set(_NEEDED) - set(detections.keypoint_names))


def person_segments(detections: Detections) -> Segments:
    """Segments of the people who are seen whole, from keypoints where head top, heels and toes are
    among them (:func:`missing_keypoints`), else from boxes.

    Head top and the mean of both feet are points of one vertical line; a box gives its top and
    bottom centre, which the solver reads through a model of the body. Boxes that touch the
    image's border are left out: the hidden end of them is unknown.
    """
    people = detections.select(detections.class_name == "person")
    if set(_NEEDED) <= set(people.keypoint_names):
        return _from_keypoints(people)
    return _from_boxes(people)


def _segments(
    people: Detections,
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    keep: Bool[np.ndarray, "n"],
    *,
    from_box: bool,
) -> Segments:
    length = np.hypot(*(foot_uv - head_uv).T)
    keep = keep & (length > MIN_LENGTH_PX)
    keep[keep] = _upwards(foot_uv[keep], head_uv[keep], people.image_size)
    return Segments(
        foot_uv=foot_uv,
        head_uv=head_uv,
        frame=people.frame,
        time_s=people.time_s,
        track=people.track,
        score=people.score,
        box_xyxy=people.box_xyxy,
        from_box=np.full(len(people), from_box),
    ).select(keep)


def _upwards(
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    image_size: tuple[int, int],
) -> Bool[np.ndarray, "n"]:
    """Which heads are above their feet: away from the nadir where the picture shows it, as it does
    of a steep camera, and nearer to the picture's upper edge elsewhere.
    """
    ordinary: np.ndarray = foot_uv[:, 1] > head_uv[:, 1]
    if ordinary.all() or len(ordinary) < _LEAST_FOR_NADIR or ordinary.mean() < _LEAST_ORDINARY:
        return ordinary
    size = np.array(image_size, float)
    u, v = np.meshgrid(np.linspace(-0.25, 1.25, 16), np.linspace(0.0, 1.0, 11))
    inside = np.column_stack([u.ravel(), v.ravel()]) * size
    u, v = np.meshgrid(np.linspace(-2, 3, 21), [1.2, 1.5, 2.0, 3.0, 5.0, 9.0, 30.0])
    below = np.column_stack([u.ravel(), v.ravel()]) * size
    some = slice(None, None, -(-len(ordinary) // _MOST_FOR_NADIR))
    agree = [_agreement(nadirs, foot_uv[some], head_uv[some]) for nadirs in (inside, below)]
    if agree[0].max() <= agree[1].max():
        return ordinary
    nadir = inside[np.argmax(agree[0])]
    return np.asarray(((head_uv - foot_uv) * (foot_uv - nadir)).sum(axis=1) > 0)


def _agreement(nadirs: np.ndarray, foot_uv: np.ndarray, head_uv: np.ndarray) -> np.ndarray:
    """How many heads lie straight away from each nadir (m,), with a soft edge."""
    body, away = head_uv - foot_uv, foot_uv - nadirs[:, None]
    turn = np.arctan2(
        body[:, 0] * away[..., 1] - body[:, 1] * away[..., 0], (body * away).sum(axis=-1)
    )
    score: np.ndarray = np.maximum(0.0, 1 - (turn / _AWAY_RAD) ** 2).sum(axis=1)
    return score


def _from_keypoints(people: Detections) -> Segments:
    index = {name: i for i, name in enumerate(people.keypoint_names)}

    def mean_of(names: tuple[str, ...]) -> np.ndarray:
        return people.keypoint_uv[:, [index[name] for name in names]].mean(axis=1)

    foot = (mean_of(LEFT_FOOT) + mean_of(RIGHT_FOOT)) / 2
    head = people.keypoint_uv[:, index[HEAD_TOP]]
    seen = people.keypoint_score[:, [index[name] for name in _NEEDED]].min(axis=1)
    keep = (seen > MIN_KEYPOINT_SCORE) & _inside(people, foot) & _inside(people, head)
    return _segments(people, foot, head, keep, from_box=False)


def _inside(people: Detections, uv: np.ndarray) -> np.ndarray:
    """Which ends are seen: whoever is cut by the border seems to end there."""
    last = np.array(people.image_size) - 1 - BORDER_PX
    return np.asarray(((uv >= BORDER_PX) & (uv <= last)).all(axis=1))


def _from_boxes(people: Detections) -> Segments:
    x1, y1, x2, y2 = people.box_xyxy.T
    middle = (x1 + x2) / 2
    width, height = people.image_size
    cut = (
        (x1 < BORDER_PX)
        | (y1 < BORDER_PX)
        | (x2 > width - 1 - BORDER_PX)
        | (y2 > height - 1 - BORDER_PX)
    )
    return _segments(
        people,
        np.column_stack([middle, y2]),
        np.column_stack([middle, y1]),
        ~cut,
        from_box=True,
    )
