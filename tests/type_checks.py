"""Types and shapes are checked at run time in every test (jaxtyping + beartype), once for each kind
of call.

Whether a call fits its annotations follows from the classes of what goes in and comes out, and from
the shapes and dtypes of arrays. A call of a kind that has passed would pass again, and is let
through: a solver calls the same functions thousands of times, and checks took four fifths of it.
What is in a list, a dict or a generator cannot be told from outside: such calls are always checked.
A function that was called a hundred times in one test with nothing new is from then on looked at
in every 16th call only, until the next test begins.
"""

import atexit
import functools
import inspect
import re
import threading
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import is_dataclass
from types import FunctionType
from typing import Any, ForwardRef, Literal, TypeVar, Unpack, get_args, get_origin, get_type_hints

import jaxtyping
import numpy as np
from beartype.door import die_if_unbearable, is_bearable

_jaxtyped = jaxtyping.jaxtyped
_PASSED: dict[Hashable, set[Hashable]] = defaultdict(set)
"""By function. Closures are made anew with each call, and one code stands for all of them."""

_CALLED: list[Callable[[], None]] = []
"""What makes the functions that were called in this test look at each call again."""

_LOOKED_AT, _LOOKED_AT_LATER = 100, 16
"""Calls of known kinds in a row that are all looked at, in one test; then one in so many."""

_LARGEST_NAMED = 48
"""Where annotations only name axes or give them numbers up to this, larger sizes are told apart by
nothing but which are equal."""

_AXIS = r"(\*?[a-z_]*|\.\.\.|[1-3]?\d|4[0-8])"
_PLAIN = re.compile(rf"{_AXIS}( {_AXIS})*")

_TOLD: set[type] = set()
"""Classes whose values annotations tell apart by nothing else."""


def install() -> None:
    """Check what is imported of the package from now on."""
    jaxtyping.jaxtyped = once  # what the hook writes above every function and class
    jaxtyping.install_import_hook("scene4d", "beartype.beartype")
    atexit.register(_forget)


def begin() -> None:
    """A test begins: every function looks at all of its calls again."""
    for anew in _CALLED:
        anew()
    _CALLED.clear()


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
    hints = inspect.get_annotations(function)
    if not hints:
        return function
    passed = _PASSED[function.__module__, function.__qualname__, function.__code__]
    parts = list(_parts(list(hints.values())))
    words, computes = any(map(_is_word, parts)), any(map(_computes, parts))
    checked = None
    alike = 0  # calls in a row of kinds that have passed
    config = jaxtyping.config

    def anew() -> None:
        nonlocal alike
        alike = 0

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal alike, checked
        if config.jaxtyping_disable:
            return function(*args, **kwargs)
        if not alike:
            _CALLED.append(anew)
        alike += 1
        if alike > _LOOKED_AT and alike % _LOOKED_AT_LATER:
            return function(*args, **kwargs)
        sizes = None if computes else {}
        kind = _kind_of((args, *kwargs.values()), words, sizes)
        given = None if kind is None else (kind, *kwargs)
        if given not in passed:
            checked = checked or _checked(function, typechecker)
            result = checked.call(args, kwargs)
            returned = _kind_of(result, words, sizes)
            if given is not None and returned is not None:
                passed.update((given, (given, returned)))
                alike = 1
            return result
        result = function(*args, **kwargs)
        returned = _kind_of(result, words, sizes)
        if (given, returned) not in passed:
            checked = checked or _checked(function, typechecker)
            checked.returned(result, args, kwargs)
            passed.add((given, returned)) if returned is not None else passed.discard(given)
        return result

    return call


def _checked(function: Callable, typechecker: Callable) -> "_ByHint | _ByChecker":
    with suppress(NameError):
        hints = get_type_hints(function, include_extras=True)
        parts = _parts(list(hints.values()))
        if not (inspect.iscoroutinefunction(function) or any(map(_is_for_functions, parts))):
            return _ByHint(function, hints)
    return _ByChecker(function, typechecker)


class _ByHint:
    """Checks of each value by its hint: hints are shared by functions, and so are their checks."""

    def __init__(self, function: Callable, hints: dict[str, Any]) -> None:
        self._function, self._hints = function, hints
        self._where = f"{function.__module__}.{function.__qualname__}"
        taken = inspect.signature(function).parameters.values()
        by_place = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        self._in_order = [one.name for one in taken if one.kind in by_place]
        names = {one.kind: one.name for one in taken}
        self._rest = names.get(inspect.Parameter.VAR_POSITIONAL, "")
        self._others = names.get(inspect.Parameter.VAR_KEYWORD, "")

    def call(self, args: tuple, kwargs: dict) -> object:
        """Call the function, checked."""
        with _jaxtyped("context"):
            self._look_at(args, kwargs)
            result = self._function(*args, **kwargs)
            self._one("return", result)
        return result

    def returned(self, result: object, args: tuple, kwargs: dict) -> None:
        """Check a call whose result is there already."""
        with _jaxtyped("context"):
            self._look_at(args, kwargs)
            self._one("return", result)

    def _look_at(self, args: tuple, kwargs: dict) -> None:
        for name, value in zip(self._in_order, args, strict=False):
            self._one(name, value)
        for value in args[len(self._in_order) :]:
            self._one(self._rest, value)
        for name, value in kwargs.items():
            self._one(name if name in self._hints else self._others, value)

    def _one(self, name: str, value: object) -> None:
        hint = self._hints.get(name, object)
        if not is_bearable(value, hint):
            die_if_unbearable(value, hint, exception_prefix=f"{self._where}, {name}: ")


class _ByChecker:
    """A function with its checks, which take milliseconds to make: calls, and results of calls."""

    def __init__(self, function: Callable, typechecker: Callable) -> None:
        held = self._held = threading.local()

        def either(*args: object, **kwargs: object) -> object:
            there = vars(held)
            return there.pop("result") if there else function(*args, **kwargs)

        # One code object here, many functions: the checker reads names and annotations of its own.
        here = FunctionType(either.__code__, function.__globals__, closure=either.__closure__)
        here = functools.update_wrapper(here, function)
        self._checked = _jaxtyped(here, typechecker=typechecker)

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


def _parts(hint: Any) -> Iterator[Any]:
    """What an annotation, or a list of them, is made of; names are not looked up."""
    inner = hint if isinstance(hint, list) else get_args(hint)
    if get_origin(hint) in (Literal, Unpack) or not inner:
        yield hint.__forward_arg__ if isinstance(hint, ForwardRef) else hint
    else:
        for one in inner:
            yield from _parts(one)


def _is_word(part: Any) -> bool:
    return get_origin(part) is Literal or (isinstance(part, str) and "Literal" in part)


def _is_for_functions(part: Any) -> bool:
    """Whether only a checker of a whole function understands it."""
    return isinstance(part, (str, TypeVar)) or get_origin(part) is Unpack


def _computes(part: Any) -> bool:
    """Whether it computes with the sizes of arrays, or may do so."""
    if isinstance(part, type) and issubclass(part, jaxtyping.AbstractArray):
        return not _PLAIN.fullmatch(part.dim_str)
    return isinstance(part, str) and bool(set(part) & set("'\""))


def _kind_of(value: Any, words: bool, sizes: dict[int, int] | None) -> Hashable:
    """All that a check of this value depends on; None where the value does not tell it.

    ``words`` says whether the annotations permit some strings and no others. With ``sizes``, large
    sizes of axes count by the order in which they come: which are equal is all that names tell.
    """
    known = value.__class__
    if known in _TOLD:
        return known
    if known is np.ndarray:
        shape = value.shape
        if sizes is not None and shape and max(shape) > _LARGEST_NAMED:
            shape = tuple(
                [n if n <= _LARGEST_NAMED else sizes.setdefault(n, -len(sizes) - 1) for n in shape]
            )
        return shape, value.dtype
    if known is tuple:
        kinds = tuple([_kind_of(one, words, sizes) for one in value])
        return None if None in kinds else kinds
    if known is str:
        return value if words else known
    if isinstance(value, type):
        return type, value
    if isinstance(value, (np.ndarray, tuple)) or hasattr(known, "__iter__"):
        return None
    _TOLD.add(known)
    return known
