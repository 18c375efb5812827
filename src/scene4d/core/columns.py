"""Tables of arrays with one row per entry."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Int

from scene4d.core.errors import InputError

T = TypeVar("T", bound="Columns")


@dataclass(frozen=True, eq=False)
class Columns:
    """A dataclass whose arrays share the first axis; other fields apply to the whole table."""

    def array_names(self) -> Iterator[str]:
        """Names of the fields that are arrays, in order."""
        return (name for name, value in vars(self).items() if isinstance(value, np.ndarray))

    def check_rows(self, what: str) -> None:
        """Raise :class:`InputError` if the arrays differ in length."""
        for name in self.array_names():
            found = len(getattr(self, name))
            if found != len(self):
                raise InputError(f"{what}: {name} has {found} rows, not {len(self)}")

    def __len__(self) -> int:
        return len(getattr(self, next(self.array_names())))

    def select(self: T, rows: Bool[np.ndarray, "n"] | Int[np.ndarray, "m"] | slice) -> T:
        """The given rows, as a mask, as indices or as a slice."""
        return replace(self, **{name: getattr(self, name)[rows] for name in self.array_names()})

    @classmethod
    def joined(cls: type[T], parts: Sequence[T]) -> T:
        """One table from several (at least one); other fields are taken from the first."""
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in parts[0].array_names()
        }
        return replace(parts[0], **arrays)
