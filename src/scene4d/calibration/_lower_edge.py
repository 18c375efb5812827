"""What an error of a box's lower edge does: it moves the foot as it lengthens the box.

Where the predicted length changes by ``s`` per row of the feet (nearly the person's over the
camera's height), an error e of the lower edge changes the seen length by e and the predicted one by
s e. Taken for an error of the length alone, it makes people who stand at one distance grow by a
pixel per row, which says that the camera hangs as low as their heads. So the spread of the residual
is that of both edges, ``1 - s (2 - s) / 2`` of the usual variance (total least squares).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import Points, Prediction
from scene4d.calibration._drift import Drifted

_LOWER_SHARE = 0.5
"""Share of a box's variance that is its lower edge's: both edges are drawn alike."""
_ROW = 1e-5
"""Step of the difference quotient by the feet's row, in half diagonals: a hundredth of a pixel."""


@dataclass(frozen=True, eq=False)
class LowerEdge:
    """``narrowing`` (n,) is the spread over the usual one, ``by_log_s`` (n,) the derivative of its
    logarithm by that of s; ``by`` (p, n) are those of log s by the free parameters and the drift,
    ``by_height`` (n,) by the person's height.
    """

    narrowing: Float[np.ndarray, "n"]
    by_log_s: Float[np.ndarray, "n"]
    by: Float[np.ndarray, "p n"]
    by_height: Float[np.ndarray, "n"]

    @classmethod
    def of(
        cls, here: Prediction, below: Prediction, points: Points, drifted: Drifted, bend: float,
        share: Float[np.ndarray, "n"],
    ) -> "LowerEdge":  # fmt: skip
        """From the heads predicted ``here`` and with the feet :data:`_ROW` lower (``below``);
        ``share`` (n,) of the variance of log length is that of a box's edges.
        """
        box = points.from_box & here.valid & below.valid
        growth = 1 - (below.head[1] - here.head[1]) / _ROW
        box = box & (growth > 0)
        growth, gain = np.where(box, growth, 1.0), drifted.gain[0]
        s = np.clip(growth * gain, 0.0, 2.0)
        both = np.where(box, _LOWER_SHARE * share, 0.0)
        narrowing2 = 1 - both * s * (2 - s)
        # By way of the growth, and of the gain, which changes with the length where drift bends.
        bent = np.where(box, 2 * bend / gain, 0.0)
        bent = bent / np.where(box, points.foot[1] - here.head[1], 1.0)
        by_parameter = (here.by_parameter[:, 1] - below.by_parameter[:, 1]) / (_ROW * growth)
        by_height = (here.by_height[1] - below.by_height[1]) / (_ROW * growth)
        by_drift = drifted.gain_by / gain
        return cls(
            np.sqrt(narrowing2),
            -both * (1 - s) * s / narrowing2,
            np.concatenate([by_parameter - bent * here.by_parameter[:, 1], by_drift]),
            by_height - bent * here.by_height[1],
        )

    def pull(
        self, force: Float[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "n"]]:
        """Half the gradient by way of the spread: by the parameters, and by each one's height.

        ``force`` (n,) is half that by the logarithm of the residual.
        """
        push = -force * self.by_log_s
        return self.by @ push, self.by_height * push


def lowered(points: Points) -> Points:
    """The points with their feet one step lower."""
    return replace(points, foot=points.foot + np.array([[0.0], [_ROW]]))
