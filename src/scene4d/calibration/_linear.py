"""The paper's linear system for the camera's height (Wagner et al. 2019, section 3.2).

With ``M = K R`` and the camera at (0, 0, C_Z), an image point (u, v) of a world point (X, Y, Z)
gives two equations that are linear in (C_Z, X, Y):

    (M₀₀ - u M₂₀) X + (M₀₁ - u M₂₁) Y - (M₀₂ - u M₂₂) C_Z = -(M₀₂ - u M₂₂) Z     (and v with M₁)

A person gives four: the foot at Z = 0 and the head at Z = the average height. As printed, with
separate (X, Y) for foot and head, N people give 4N equations in 4N + 1 unknowns, of rank 4N: C_Z
is free. A person stands upright, so head and foot share (X, Y): 4N equations, 2N + 1 unknowns.
Eliminating each person's (X, Y) leaves one equation for C_Z: O(N), and no N-sized matrix.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError


@dataclass(frozen=True, eq=False)
class HeightSystem:
    """Normal equation of C_Z with every person's (X, Y) eliminated.

    ``information[i] · C_Z = moment[i]`` is person i's share of the scalar normal equation, so the
    least-squares C_Z of any subset is ``moment.sum() / information.sum()``.
    """

    information: Float[np.ndarray, "n"]
    moment: Float[np.ndarray, "n"]

    def solve(self) -> float:
        """Least-squares C_Z in metres; raises where the people leave it free."""
        information = float(self.information.sum())
        if not information > 0:
            raise InputError("the camera's height is not determined: no usable person")
        return float(self.moment.sum()) / information

    @property
    def each(self) -> Float[np.ndarray, "n"]:
        """The C_Z (m) that each person alone suggests; NaN or infinite where none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.moment / self.information


def height_system(
    K: Float[np.ndarray, "3 3"],
    R: Float[np.ndarray, "3 3"],
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    person_height_m: float,
) -> HeightSystem:
    """The scalar system of N upright people, one Schur complement per person, vectorised.

    Each equation is divided by the focal length, so that its residual is in radians.
    """
    a, b, c = person_equations(K, R, foot_uv, head_uv, person_height_m)
    # Orthogonal complement of each 4x2 block: y - A (AᵀA)⁻¹ Aᵀ y.
    gram = np.einsum("nij,nik->njk", a, a)
    right = np.einsum("nij,nik->njk", a, np.stack([b, c], axis=2))
    det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    usable = det > 1e-12 * gram[:, 0, 0] * gram[:, 1, 1]
    gram[~usable] = np.eye(2)
    solved = np.linalg.solve(gram, right)
    b_free = b - np.einsum("nij,nj->ni", a, solved[:, :, 0])
    c_free = c - np.einsum("nij,nj->ni", a, solved[:, :, 1])
    information = np.where(usable, (b_free * b_free).sum(axis=1), 0.0)
    return HeightSystem(information, np.where(usable, (b_free * c_free).sum(axis=1), 0.0))


def person_equations(
    K: Float[np.ndarray, "3 3"],
    R: Float[np.ndarray, "3 3"],
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    person_height_m: float,
) -> tuple[Float[np.ndarray, "n 4 2"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
    """``(A, b, c)`` with ``A (X, Y) + b C_Z = c``: four equations a person, foot then head."""
    M = (K @ R) / K[0, 0]
    rows = np.stack(
        [
            M[axis] - points[:, axis, None] * M[2]
            for points in (foot_uv, head_uv)
            for axis in (0, 1)
        ],
        axis=1,
    )  # (n, 4, 3): foot u, foot v, head u, head v
    z = np.array([0.0, 0.0, person_height_m, person_height_m])
    return rows[:, :, :2], -rows[:, :, 2], -rows[:, :, 2] * z
