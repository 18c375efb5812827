"""Probabilities of pairs that exclude one another, from the odds of each alone."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csr_array

_ROUNDS = 60
"""Enough for what is told apart at all to settle to 1e-3 (on random cases, against all ways of
pairing counted out)."""
_MOST = 40.0
"""Log-odds beyond which nothing changes any more."""


def marginals(
    log_odds: Float[np.ndarray, "n"],
    row_rivals: Int[np.ndarray, "k 2"],
    column_rivals: Int[np.ndarray, "m 2"],
) -> Float[np.ndarray, "n"]:
    """The probability of each of n pairs (i, j), where of rivals at most one is true.

    ``log_odds`` are those against "neither": that i has no partner. ``row_rivals`` are pairs of
    numbers of pairs that share i and exclude each other, in both orders; ``column_rivals`` those
    that share j. Belief propagation for data association (Williams and Lau, "Approximate evaluation
    of marginal association probabilities with belief propagation", IEEE Transactions on Aerospace
    and Electronic Systems, 2014).
    """
    n = len(log_odds)
    weight = np.exp(np.clip(log_odds, -_MOST, _MOST))
    of_row, of_column = _sums(n, row_rivals), _sums(n, column_rivals)
    to_row = np.ones(n)
    for _ in range(_ROUNDS):
        to_column = weight / (1 + of_row @ (weight * to_row))
        to_row = 1 / (1 + of_column @ to_column)
    alone = weight * to_row
    found: np.ndarray = alone / (1 + alone + of_row @ alone)
    return found


def _sums(n: int, rivals: Int[np.ndarray, "k 2"]) -> csr_array:
    """A matrix that adds up what belongs to the rivals of each."""
    return coo_array((np.ones(len(rivals)), (rivals[:, 0], rivals[:, 1])), (n, n)).tocsr()
