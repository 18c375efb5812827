""" "Or" between clauses: what each alternative says in full."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

from scene4d.core.errors import InputError
from scene4d.searching.language._sentences import Clause, Joined, Sentence, options_of
from scene4d.searching.language._words import Word, refuse

if TYPE_CHECKING:
    from scene4d.searching.language._query import Query

_ENDS = 3
"""Alternatives that share what comes after differ in so many words at most."""


_DENIES = ("not", "no", "never", "nobody", "noone", "no-one", "nothing")
"""What is said of both where "or" shares it: "not A or B" is neither, and no alternatives."""


@dataclass(frozen=True)
class Reading:
    """A search without alternatives, and how it was said."""

    query: "Query"
    said: Sentence


_Read = Callable[[str, bool], list[Reading]]
"""Reads a search; with True it says less of what is not understood."""
_Alike = Callable[[Word, Word], bool]


def either(
    text: str, words: Sequence[Word], read: _Read, are_alike: _Alike
) -> list[Reading] | None:
    """The alternatives of a search; None where it has none. ``read`` reads each of them;
    ``are_alike`` says whether two words can begin what "or" joins.

    "A runs or B stops" says both in full; "A enters or leaves a car" shares its beginning and its
    end; "A walks or is near a car" its beginning. Raises :class:`InputError` where this makes no
    sense, and for an alternative of several steps: how much of them is shared cannot be told.
    """
    place = next((at for at, word in enumerate(words) if word.value == "or"), None)
    if place is None:
        return None
    left = [w for w in words[:place] if w.surface.casefold() != "either"]
    left = left[:-1] if left and left[-1].kind == "comma" else left
    right = words[place + 1 :]
    if not left or not right:
        raise refuse(text, words[place].start, '"or" of what?')
    denied = next((word for word in left if word.value in _DENIES), None)
    for first, second, shared in _ways(text, left, right, read, are_alike):
        if denied is not None and second != _said(text, right):
            what = f'"{denied.surface}" of both, or of either? Say each in full'
            raise refuse(text, denied.start, what)
        try:
            found = [*read(first, True), *read(second, True)]
        except InputError:
            continue
        for one in found:
            if not _is_single(one.said):
                what = (
                    f'"or" beside "then", "and" or "while": search twice, as in "{first}; {second}"'
                )
                raise refuse(text, words[place].start, what)
        note = [f'"{shared}" is said of every alternative'] if shared else []
        return [_noted(one, found, note) for one in _distinct(found)]
    return [*read(first, False), *read(second, False)]  # raises: the last way


def _distinct(found: Sequence[Reading]) -> list[Reading]:
    """Those that are not said twice: "stops or parks"."""
    said = [(replace(one.query.activity, name=""), one.query.window) for one in found]
    return [one for at, one in enumerate(found) if said[at] not in said[:at]]


def _noted(one: Reading, found: Sequence[Reading], note: Sequence[str]) -> Reading:
    """With its notes, and named as it was said where another one has its name."""
    query, activity = one.query, one.query.activity
    if sum(other.query.activity.name == activity.name for other in _distinct(found)) > 1:
        activity = replace(activity, name=query.text)
    return replace(one, query=replace(query, activity=activity, notes=[*query.notes, *note]))


def _ways(
    text: str, left: Sequence[Word], right: Sequence[Word], read: _Read, are_alike: _Alike
) -> Iterator[tuple[str, str, str]]:
    """Pairs of alternatives, the likeliest first, with the end that they share."""
    whole = _said(text, right)
    until = next((at for at, word in enumerate(right) if word.value == "or"), len(right))
    first, second = _said(text, left), _said(text, right[:until])
    of_left = of_right = ""
    with suppress(InputError):
        of_left = _subject(read(first, True))
        of_right = _subject(read(second, True))
    has_subject = of_right not in ("", second) or (of_left, of_right) == (first, second)
    if has_subject and (of_left == first) != (of_right == second):
        tail = second.removeprefix(of_right).strip()
        yield f"{first} {tail}", whole, tail  # "a red car or a white van stops"
    begins = [n for n in range(1, len(left)) if are_alike(left[-n], right[0])]
    begins.sort(key=lambda n: left[-n].value != right[0].value)  # "a" of "a", not "a a"
    if not has_subject:
        short = [n for n in begins if n <= _ENDS]
        tails = product(short, range(1, min(_ENDS, len(right) - 1) + 1))
        for i, j in tails:
            tail = _said(text, right[j:])
            yield (
                f"{first} {tail}",
                f"{_said(text, left[:-i])} {_said(text, right[:j])} {tail}",
                tail,
            )
        for i in begins:
            yield first, f"{_said(text, left[:-i])} {whole}", ""
        whole = f"{of_left} {whole}".strip()
    yield first, whole, ""


def _said(text: str, words: Sequence[Word]) -> str:
    return text[words[0].start : words[-1].end] if words else ""


def _clauses(said: Sentence) -> Iterator[Sequence[Clause]]:
    """The clauses of each step, in its first reading."""
    for step in options_of(said.order)[0].steps:
        joined = options_of(step)[0]
        if isinstance(joined, Joined):
            yield [options_of(clause)[0] for clause in joined.clauses]
        else:
            yield from ([], [])


def _is_single(said: Sentence) -> bool:
    return [len(clauses) for clauses in _clauses(said)] == [1]


def _subject(read: Sequence[Reading]) -> str:
    """Whom the first clause is about, in its words; none where it does not say."""
    first = next(_clauses(read[0].said))
    nouns = first[0].subjects if first else ()
    return read[0].query.text[nouns[0].span[0] : nouns[-1].span[1]] if nouns else ""
