"""Types and shapes are checked at run time in every test (jaxtyping + beartype), once for each kind
of call.

Whether a call fits its annotations follows from the classes of what goes in and comes out, and from
the shapes and dtypes of arrays. A call of a kind that has passed would pass again, and is let
through: a solver calls the same functions thousands of times, and checks took four fifths of it.
What is in a list, a dict or a generator cannot be told from outside: such calls are always checked.
"""

import atexit
import functools
import inspect
import threading
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from types import FunctionType
from typing import Any, ForwardRef, Literal, TypeVar, get_args, get_origin

import jaxtyping
import numpy as np

_jaxtyped = jaxtyping.jaxtyped
_PASSED: dict[Hashable, set[Hashable]] = defaultdict(set)
"""By function. Closures are made anew with each call, and one code stands for all of them."""

_TOLD: set[type] = set()
"""Classes whose values annotations tell apart by nothing else."""


def install() -> None:
    """Check what is imported of the package from now on."""
    jaxtyping.jaxtyped = once  # what the hook writes above every function and class
    jaxtyping.install_import_hook("scene4d", "beartype.beartype")
    atexit.register(_forget)


def _forget() -> None:
    """Keep no class of an extension alive longer than its module, which would report it."""
    _TOLD.clear()
    for passed in _PASSED.values():
        passed.clear()


@contextmanager
def unchecked() -> Iterator[None]:
    """As users run it."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", before)


def once(target: Any = None, *, typechecker: Callable) -> Any:
    """Takes the place of ``jaxtyping.jaxtyped``."""
    if target is None:
        return functools.partial(once, typechecker=typechecker)
    if inspect.isfunction(target):
        return _once(target, typechecker)
    if is_dataclass(target) and "__init__" in vars(target):
        target.__init__ = _once(target.__init__, typechecker)
    return target


def _once(function: Callable, typechecker: Callable) -> Callable:
    passed = _PASSED[function.__module__, function.__qualname__, function.__code__]
    checked = functools.cache(lambda: _Checked(function, typechecker))
    words = "Literal" in repr(inspect.get_annotations(function))

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if jaxtyping.config.jaxtyping_disable:
            return function(*args, **kwargs)
        kind = _kind_of((args, *kwargs.values()), words)
        given = None if kind is None else (kind, *kwargs)
        if given not in passed:
            result = checked().call(args, kwargs)
            returned = _kind_of(result, words)
            if given is not None and returned is not None:
                passed.update((given, (given, returned)))
            return result
        result = function(*args, **kwargs)
        returned = _kind_of(result, words)
        if (given, returned) not in passed:
            checked().returned(result, args, kwargs)
            passed.add((given, returned)) if returned is not None else passed.discard(given)
        return result

    return call


class _Checked:
    """A function with its checks, which take milliseconds to make: calls, and results of calls."""

    def __init__(self, function: Callable, typechecker: Callable) -> None:
        held = self._held = threading.local()

        def either(*args: object, **kwargs: object) -> object:
            there = vars(held)
            return there.pop("result") if there else function(*args, **kwargs)

        # One code object here, many functions: the checker reads names and annotations of its own.
        here = FunctionType(either.__code__, function.__globals__, closure=either.__closure__)
        here = functools.update_wrapper(here, function)
        if any(map(_shaped, inspect.get_annotations(function).values())):
            self._checked = _jaxtyped(here, typechecker=typechecker)
        else:  # jaxtyping would add nothing but time
            self._checked = typechecker(here)

    def call(self, args: tuple, kwargs: dict) -> object:
        """Call the function, checked."""
        return self._checked(*args, **kwargs)

    def returned(self, result: object, args: tuple, kwargs: dict) -> None:
        """Check a call whose result is there already."""
        self._held.result = result
        try:
            self._checked(*args, **kwargs)
        finally:
            vars(self._held).clear()


def _shaped(hint: Any) -> bool:
    """Whether an annotation holds an array's shape, or may do so: a name is not looked up."""
    if isinstance(hint, list):  # what a Callable takes
        return any(map(_shaped, hint))
    if isinstance(hint, (str, ForwardRef, TypeVar)):
        return True
    if isinstance(hint, type) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return get_origin(hint) is not Literal and any(map(_shaped, get_args(hint)))


def _kind_of(value: Any, words: bool) -> Hashable:
    """All that a check of this value depends on; None where the value does not tell it.

    ``words`` says whether the annotations permit some strings and no others.
    """
    known = value.__class__
    if known in _TOLD:
        return known
    if known is np.ndarray:
        return value.shape, value.dtype
    if known is tuple:
        kinds = tuple([_kind_of(one, words) for one in value])
        return None if None in kinds else kinds
    if known is str:
        return value if words else known
    if isinstance(value, type):
        return type, value
    if isinstance(value, (np.ndarray, tuple)) or hasattr(known, "__iter__"):
        return None
    _TOLD.add(known)
    return known
