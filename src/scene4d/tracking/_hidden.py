"""Where somebody may be who is hidden behind a vehicle or somebody else, seen from the camera.

A cloud of possible walks, each with the motion model's noise, some of which rest for a while. In
every frame those count for less that would be seen: the upright box of a person there is in the
picture, and no box of the frame that stands before it covers it. So the cloud stays behind what
hides him, and is gone a second or two after that has driven off.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.boxes import covered
from scene4d.core.camera import Camera
from scene4d.tracking._motion_model import MOTIONS, moving_noise

MEAN_HIDDEN_S = 10.0
"""How long people stay behind something, on average. Chosen by hand: at 1.3 m/s a car is passed in
4 s and a bus in 8 s, and who rests or loads something there stays for longer. What that gives:
``python -m benchmarks.hidden``."""
LONGEST_S = 15.0
"""After this nobody is expected to come out: whoever does may be anybody. Chosen by hand."""
_COMES_OUT = 0.5
"""Share of those who vanish at a vehicle who have not entered it: 175 of 324 on MEVA's tuning
cameras (:mod:`scene4d.searching.predicates._visibility`)."""
_LEAST = float(np.exp(-3.0))
"""A hypothesis ends when fewer of its walks than this have stayed unseen."""
_STOPS_S, _RESTS_S = 5.0, 5.0
"""How long people walk before they stop behind something, and rest before they go on."""
_SEEN_MOST = 0.8
"""P(seen) of a second in full view: who is overlooked once is easily overlooked again. As in
searching, chosen by hand like all that follows."""
_BEGINS_SHARE = 0.3
"""Share of the last box, carried on, that is covered when somebody vanishes behind something."""
_COVERED_SHARE, _COVERED_SIGMA = 0.5, 0.15
"""Share of a person that is covered when he is not detected, and how sharply."""
_BEFORE_SIGMA = 0.05
"""How sharply the nearer of two is known by the lower edges of their boxes, in heights."""
_WIDTH_SHARE = 0.35
"""Width of an upright person over the height."""
_WALKS = 128
_FEWEST = 32.0
"""With an effective number of walks below this they are drawn anew."""


@dataclass
class _Cloud:
    """``state`` (k, 4) position and velocity; ``weight`` (k,) sums to P(not seen | still about)."""

    seen_s: float
    time_s: float
    state: np.ndarray
    weight: np.ndarray
    rng: np.random.Generator

    @property
    def probability(self) -> float:
        """That he is to come out still: he has not entered, not left, and not been seen."""
        stayed = np.exp(-(self.time_s - self.seen_s) / MEAN_HIDDEN_S)
        return float(_COMES_OUT * self.weight.sum() * stayed)


class Hidden:
    """Hypotheses about people who vanished behind something, by their track's number."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._clouds: dict[int, _Cloud] = {}

    def __contains__(self, track: int) -> bool:
        return track in self._clouds

    def begin(
        self,
        track: int,
        seen_s: float,
        state: Float[np.ndarray, "4"],
        covariance: Float[np.ndarray, "4 4"],
    ) -> None:
        """Somebody vanished, last seen with this state."""
        rng = np.random.default_rng(track)
        walks = rng.multivariate_normal(state, covariance, _WALKS)
        weight = np.full(_WALKS, 1 / _WALKS)
        self._clouds[track] = _Cloud(seen_s, seen_s, walks, weight, rng)

    def keep(self, tracks: set[int]) -> None:
        """Forget all others."""
        self._clouds = {track: cloud for track, cloud in self._clouds.items() if track in tracks}

    def advance(self, time_s: float, boxes_xyxy: Float[np.ndarray, "n 4"]) -> None:
        """Let everybody walk until now, and weigh by the frame, in which none of them was seen;
        drop what is not probable any more.
        """
        for cloud in self._clouds.values():
            self._advance(cloud, time_s, boxes_xyxy)
        alive = {track: cloud for track, cloud in self._clouds.items() if _is_alive(cloud)}
        self._clouds = alive

    def predicted(
        self, track: int, time_s: float
    ) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "4 4"], float]:
        """Mean and covariance of the state, and the probability that he is to come out still."""
        cloud = self._clouds[track]
        share = cloud.weight / cloud.weight.sum()
        step, of_axis = _step(time_s - cloud.time_s)
        noise = np.kron(of_axis, np.eye(2))
        mean = share @ cloud.state
        away = cloud.state - mean
        covariance = (away * share[:, None]).T @ away
        return step @ mean, step @ covariance @ step.T + noise, cloud.probability

    def upright_px(self, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Height in the picture of a person of usual height at places on the ground."""
        box = self._upright(xy_m)
        return box[:, 3] - box[:, 1]

    def _advance(self, cloud: _Cloud, time_s: float, boxes: np.ndarray) -> None:
        passed_s = time_s - cloud.time_s
        if passed_s <= 0:
            return
        cloud.state = _walked(cloud.state, passed_s, cloud.rng)
        gone = self._gone(cloud.state[:, :2], boxes)
        cloud.weight = cloud.weight * (1 - gone) ** passed_s
        cloud.time_s = time_s
        total = cloud.weight.sum()
        if total > 0 and total**2 / (cloud.weight**2).sum() < _FEWEST:
            place = (cloud.rng.random() + np.arange(_WALKS)) / _WALKS
            drawn = np.searchsorted(np.cumsum(cloud.weight) / total, place)
            cloud.state = cloud.state[np.minimum(drawn, _WALKS - 1)]
            cloud.weight = np.full(_WALKS, total / _WALKS)

    def _gone(self, xy_m: np.ndarray, boxes: np.ndarray) -> Float[np.ndarray, "k"]:
        """P(seen within a second) of who is in the picture; 1 of who has left it."""
        box = self._upright(xy_m)
        tall = np.maximum(box[:, 3] - box[:, 1], 1.0)
        middle, size = (box[:, :2] + box[:, 2:]) / 2, np.array(self._camera.image_size)
        inside = ((middle >= 0) & (middle <= size - 1)).all(axis=1)
        hides = hidden_by(box[:, None], boxes, tall[:, None])
        return np.where(inside, _SEEN_MOST * np.prod(1 - hides, axis=1), 1.0)

    def _upright(self, xy_m: np.ndarray) -> Float[np.ndarray, "k 4"]:
        foot, head = (
            self._camera.project(np.column_stack([xy_m, np.full(len(xy_m), z)]))[0]
            for z in (0.0, PERSON_HEIGHT_M)
        )
        return upright_box(np.nan_to_num((foot[:, 0] + head[:, 0]) / 2), head[:, 1], foot[:, 1])


def upright_box(
    middle_u: Float[np.ndarray, "k"], top_v: Float[np.ndarray, "k"], foot_v: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "k 4"]:
    """Boxes of upright people."""
    half = _WIDTH_SHARE / 2 * (foot_v - top_v)
    return np.column_stack([middle_u - half, top_v, middle_u + half, foot_v])


def vanishes(
    foot_uv: Float[np.ndarray, "t 2"], height: Float[np.ndarray, "t"], boxes: np.ndarray
) -> np.ndarray:
    """Of people who are not seen at such places, who may be behind one of the boxes."""
    box = upright_box(foot_uv[:, 0], foot_uv[:, 1] - height, foot_uv[:, 1])
    before = boxes[:, 3] > (foot_uv[:, 1] + _BEFORE_SIGMA * height)[:, None]
    share = covered(box[:, None], boxes) * before
    return np.asarray(share.max(axis=1, initial=0.0) >= _BEGINS_SHARE)


def hidden_by(
    box: Float[np.ndarray, "k 1 4"], by: Float[np.ndarray, "n 4"], tall: Float[np.ndarray, "k 1"]
) -> Float[np.ndarray, "k n"]:
    """P(each of the boxes ``by`` hides who stands in ``box``)."""
    before = ndtr((by[:, 3] - box[..., 3]) / (_BEFORE_SIGMA * tall))
    share = ndtr((covered(box, by) - _COVERED_SHARE) / _COVERED_SIGMA)
    return np.nan_to_num(before * share)


def _is_alive(cloud: _Cloud) -> bool:
    return bool(cloud.weight.sum() >= _LEAST and cloud.time_s - cloud.seen_s <= LONGEST_S)


def _walked(
    state: Float[np.ndarray, "k 4"], passed_s: float, rng: np.random.Generator
) -> Float[np.ndarray, "k 4"]:
    """States some time later."""
    state, draw = state.copy(), rng.random(len(state))
    rests = ~state[:, 2:].any(axis=1)
    stops = ~rests & (draw < -np.expm1(-passed_s / _STOPS_S))
    goes = rests & (draw < -np.expm1(-passed_s / _RESTS_S))
    state[stops, 2:] = 0.0
    state[goes, 2:] = rng.normal(0.0, MOTIONS["person"].speed, (int(goes.sum()), 2))
    step, of_axis = _step(passed_s)
    stays = (rests & ~goes) | stops
    pushed = np.linalg.cholesky(of_axis) @ rng.standard_normal((len(state), 2, 2))
    walked = state @ step.T + pushed.reshape(-1, 4)  # position and velocity, of both axes each
    return np.where(stays[:, None], state, walked)


def _step(passed_s: float) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "2 2"]]:
    """Transition of a person's (x, y, vx, vy), and noise of (position, velocity) along an axis."""
    step = np.eye(4)
    step[0, 2] = step[1, 3] = passed_s
    (of_axis,) = moving_noise(np.array([passed_s]), np.array([MOTIONS["person"].acceleration]))
    return step, of_axis
