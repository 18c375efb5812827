"""Probabilities of pairs that exclude one another, from the odds of each alone."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array

_ROUNDS = 60
"""Enough for what is told apart at all to settle to 1e-3 (on random cases, against all ways of
pairing counted out)."""
_MOST = 40.0
"""Log-odds beyond which nothing changes any more."""
Rivals = Callable[[np.ndarray], np.ndarray]
"""Adds up, for each pair, the values of those that it excludes."""


def marginals(
    log_odds: Float[np.ndarray, "n"], of_row: Rivals, of_column: Rivals
) -> Float[np.ndarray, "n"]:
    """The probability of each of n pairs (i, j), where of rivals at most one is true.

    ``log_odds`` are those against "neither": that i has no partner. ``of_row`` adds up pairs that
    share i and exclude each other, ``of_column`` those that share j. Belief propagation for data
    association (Williams and Lau, "Approximate evaluation of marginal association probabilities
    with belief propagation", IEEE Transactions on Aerospace and Electronic Systems, 2014).
    """
    weight = np.exp(np.clip(log_odds, -_MOST, _MOST))
    to_row = np.ones(len(log_odds))
    for _ in range(_ROUNDS):
        to_column = weight / (1 + of_row(weight * to_row))
        to_row = 1 / (1 + of_column(to_column))
    alone = weight * to_row
    found: np.ndarray = alone / (1 + alone + of_row(alone))
    return found


def named(n: int, rivals: Int[np.ndarray, "k 2"]) -> Rivals:
    """Rivals among n pairs that are listed, in both orders."""
    matrix = coo_array((np.ones(len(rivals)), (rivals[:, 0], rivals[:, 1])), (n, n)).tocsr()
    return lambda values: np.asarray(matrix @ values)


def all_of(member: Int[np.ndarray, "n"]) -> Rivals:
    """All pairs that share a member exclude each other."""
    _, group = np.unique(member, return_inverse=True)

    def summed(values: np.ndarray) -> np.ndarray:
        others: np.ndarray = np.bincount(group, values)[group] - values
        return np.maximum(others, 0.0)

    return summed
