"""Arrays of many short runs: expanding ranges, the largest value of many windows."""

import numpy as np
from jaxtyping import Float, Int


def expand(
    first: Int[np.ndarray, "n"], count: Int[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"]]:
    """The ranges ``first, first + 1, ...`` one behind the other: which range, and the number."""
    owner = np.repeat(np.arange(len(first)), count)
    begins = np.cumsum(count) - count
    return owner, first[owner] + np.arange(len(owner)) - begins[owner]


def window_max(
    values: Float[np.ndarray, "n"], low: Int[np.ndarray, "m"], high: Int[np.ndarray, "m"]
) -> Float[np.ndarray, "m"]:
    """``max(values[low : high + 1])`` of every window; minus infinity where it is empty.

    A sparse table of which only one level is kept at a time: O(n log w) for windows of w.
    """
    out = np.full(len(low), -np.inf)
    length = high - low + 1
    some = np.flatnonzero(length > 0)
    if len(some) == 0:
        return out
    level = np.frexp(length[some].astype(float))[1] - 1
    table = values
    for step in range(int(level.max()) + 1):
        at = some[level == step]
        if len(at):
            out[at] = np.maximum(table[low[at]], table[high[at] + 1 - (1 << step)])
        half = 1 << step
        if len(table) > half:
            table = np.maximum(table[:-half], table[half:])
    return out


def runs(*keys: Int[np.ndarray, "n"]) -> Int[np.ndarray, "w"]:
    """Where rows with other keys than the row before begin."""
    if len(keys[0]) == 0:
        return np.zeros(0, int)
    new = np.zeros(len(keys[0]), bool)
    new[0] = True
    for key in keys:
        new[1:] |= key[1:] != key[:-1]
    return np.flatnonzero(new)
