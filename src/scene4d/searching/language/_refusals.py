"""Words that are understood and cannot be answered: why, and what comes closest."""

import re
from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from itertools import islice

from scene4d.searching.language._lexicon import Refusal, base_forms, read_lexicon

_LOOKED_AHEAD = 8
"""Words: the longest patterns have fewer."""
_WORD = re.compile(r"[^\W\d_]+(?:-[^\W\d_]+)*|\d+|[,;.]")
_ARTICLES = ("a", "an", "the", "his", "her", "their", "its", "some", "any", "another", "my")


def refusal_at(text: str, at: int, is_known: bool) -> tuple[str, Refusal] | None:
    """The refused words that begin at a character, and their refusal; the longest that match.

    A single word is refused only where nothing else is known to be meant by it (``is_known``). In
    a pattern "=" stands before words that are meant in this form alone.
    """
    there = list(islice(_WORD.finditer(text, at), _LOOKED_AHEAD))
    words = [match.group().casefold() for match in there]
    best: tuple[int, Refusal] | None = None
    for form in dict.fromkeys((words[0], *base_forms(words[0]))) if words else ():
        for pieces, refusal in _by_first_word().get(form, ()):
            if (len(pieces) == 1 and is_known) or (pieces[0][0] == "=" and form != words[0]):
                continue
            length = _matched(pieces[1:], words[1:])
            if length is not None and (best is None or length + 1 > best[0]):
                best = length + 1, refusal
    if best is None:
        return None
    return text[at : there[best[0] - 1].end()], best[1]


@cache
def _by_first_word() -> dict[str, list[tuple[tuple[str, ...], Refusal]]]:
    found: dict[str, list[tuple[tuple[str, ...], Refusal]]] = {}
    for refusal in read_lexicon().refusals:
        for pattern in refusal.words:
            first, *rest = pattern.split()
            for word in first.removeprefix("=").split("|"):
                whole = f"={word}" if first[0] == "=" else word
                found.setdefault(word, []).append(((whole, *rest), refusal))
    return found


def _matched(pieces: Sequence[str], words: Sequence[str]) -> int | None:
    """How many words the rest of a pattern takes, None where it does not match."""
    at = 0
    for piece in pieces:
        word = words[at] if at < len(words) else ""
        if piece == "{a}":
            at += word in _ARTICLES
        elif (piece == "NUMBER" and (word.isdigit() or word in _numbers())) or (
            piece == "{thing}" and _is_one_of(word, read_lexicon().things["object"])
        ):
            at += 1
        elif piece[0] == "=":
            if word != piece[1:]:
                return None
            at += 1
        elif _is_one_of(word, piece.removesuffix("?").split("|")):
            at += 1
        elif not piece.endswith("?"):
            return None
    return at


def _is_one_of(word: str, wanted: Sequence[str]) -> bool:
    return bool(word) and any(form in wanted for form in (word, *base_forms(word)))


def _numbers() -> Iterator[str]:
    return (word for _, words in read_lexicon().numbers for word in words)


@lru_cache(maxsize=1024)
def plain(text: str) -> str:
    """A text without articles, its words in their base form."""
    words = [match.group().casefold() for match in _WORD.finditer(text)]
    return " ".join(next(iter(base_forms(w)), w) for w in words if w not in _ARTICLES)
