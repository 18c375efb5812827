"""Gaussian Markov chains of many objects at once: means and covariances of all their states.

The smoother's equations are a block-tridiagonal system, one block row per moment. Eliminating
every second row at a time (cyclic reduction: Buzbee, Golub and Nielson, "On direct methods for
solving Poisson's equations", 1970) takes log2(n) array operations instead of n steps of a loop;
on the way back the blocks of the inverse follow as in Takahashi's equations. The result is that
of the Rauch-Tung-Striebel smoother.
"""

import numpy as np
from jaxtyping import Float


def solve_chain(
    diagonal: Float[np.ndarray, "n s s"],
    coupling: Float[np.ndarray, "m s s"],
    vector: Float[np.ndarray, "n s"],
    *,
    covariance: bool = True,
) -> tuple[Float[np.ndarray, "n s"], Float[np.ndarray, "n s s"] | None]:
    """Means (n, s), and where asked covariances (n, s, s), of a chain in information form.

    The precision matrix has ``diagonal`` blocks and, right of the k-th, ``coupling[k]``
    (m = n - 1); mean = precision⁻¹ ``vector``. Chains of several objects stand one behind the
    other, with zero coupling between them.
    """
    mean, cov, _ = _solve(diagonal, coupling, vector[:, :, None], covariance)
    return mean[:, :, 0], cov


def _t(a: np.ndarray) -> np.ndarray:
    return a.swapaxes(-1, -2)


def _solve(
    d: np.ndarray, u: np.ndarray, y: np.ndarray, covariance: bool
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Mean, covariances, and covariances of neighbours (n - 1, s, s)."""
    n, s = y.shape[:2]
    if n <= 1:
        inverse = np.linalg.inv(d)
        return inverse @ y, inverse if covariance else None, np.empty((0, s, s))
    # Odd rows are eliminated; each has a row to the left, and all but perhaps the last one to the
    # right, for which zeros stand in.
    inverse = np.linalg.inv(d[1::2])
    odd = len(inverse)
    to_left, to_right = _t(u[0::2]), np.zeros((odd, s, s))
    to_right[: len(u[1::2])] = u[1::2]
    from_left, from_right, own = inverse @ to_left, inverse @ to_right, inverse @ y[1::2]
    right = n - odd - 1  # so many even rows have an odd row on their left
    d_even, y_even = d[0::2].copy(), y[0::2].copy()
    d_even[:odd] -= _t(to_left) @ from_left
    y_even[:odd] -= _t(to_left) @ own
    d_even[1:] -= (_t(to_right) @ from_right)[:right]
    y_even[1:] -= (_t(to_right) @ own)[:right]
    between = -(_t(to_left) @ from_right)[:right]
    mean_even, cov_even, cov_between = _solve(d_even, between, y_even, covariance)

    def beyond(values: np.ndarray) -> np.ndarray:
        """The even row right of every odd one."""
        out = np.zeros((odd, *values.shape[1:]))
        out[:right] = values[1:]
        return out

    mean = np.empty_like(y)
    mean[0::2] = mean_even
    mean[1::2] = own - from_left @ mean_even[:odd] - from_right @ beyond(mean_even)
    if cov_even is None or cov_between is None:
        return mean, None, None
    cross = np.zeros((odd, s, s))
    cross[:right] = cov_between
    with_left = -(from_left @ cov_even[:odd] + from_right @ _t(cross))
    with_right = -(from_left @ cross + from_right @ beyond(cov_even))
    cov, neighbours = np.empty((n, s, s)), np.empty((n - 1, s, s))
    cov[0::2] = cov_even
    cov[1::2] = inverse - with_left @ _t(from_left) - with_right @ _t(from_right)
    neighbours[0::2] = _t(with_left)
    neighbours[1::2] = with_right[: len(u[1::2])]
    return mean, cov, neighbours
