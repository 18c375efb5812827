"""A search as tokens with positions: words in their base form, numbers, times of day, names; and
what numbers and times of day amount to, exact until they are rounded once.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from fractions import Fraction

from scene4d.core.errors import InputError
from scene4d.searching.language._lexicon import Refusal, base_forms, read_lexicon
from scene4d.searching.language._refusals import plain, refusal_at

_MOST_WORDS = 60
"""Bounds the time of a parse; longer searches are refused."""
_MOST_DIGITS = 20
"""Longer numbers are refused as mistakes."""
_MOST = 10**9
"""Largest distance, duration or speed, in metres and seconds: about 30 years."""

_TOKEN = re.compile(
    r"""(?P<quoted>"[^"]*"|“[^”]*”)
    |(?P<clock>\d{1,2}:\d{2}(?::\d{2})?(?:\s*[ap]\.?m\b\.?)?|\d{1,2}\s*(?:[ap]\.?m\b\.?|o['’]clock))
    |(?P<to>(?<=\d)\s*[-–]\s*(?=\d))
    |(?P<number>\d+(?:[.,]\d+)*|\.\d+)
    |(?P<not>(?:n['’]t)\b)
    |(?P<whose>['’]s?(?!\w))
    |(?P<unit>[^\W\d_]+/[^\W\d_]+)
    |(?P<word>[^\W\d_]+?(?=n['’]t\b)|[^\W\d_]+(?:-[^\W\d_]+)*)
    |(?P<comma>[,;]|\.(?=\s+\S))
    |(?P<space>[\s_]+|[.?!]+(?=\s*$))
    |(?P<other>.)""",
    re.VERBOSE | re.IGNORECASE,
)
_NOTHING = "this sign means nothing here"
_SHORTENED = {"ca": "can", "wo": "will"}
_CLOCK = re.compile(
    r"(?P<hour>\d{1,2})(?::(?P<minute>\d{2}))?(?::(?P<second>\d{2}))?\s*(?P<half>[ap])?\.?m?\.?(?:o['’]clock)?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Word:
    """A token: its ``kind`` (word, number, clock, zone, line, comma, whose), its base form or
    value, and where it stands in the text, from ``start`` up to ``end``.
    """

    kind: str
    value: str
    start: int
    end: int
    surface: str


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """The known words, the phrases of the catalogue (None while these are read themselves), and the
    names of places by their kind ("zone", "line"); with ``names_first`` what is a word and a name
    is the name.
    """

    words: Collection[str]
    phrases: Sequence[str] | None = ()
    places: Mapping[str, Sequence[str]] = field(default_factory=lambda: {"zone": (), "line": ()})
    names_first: bool = False

    def word(self, surface: str) -> str | None:
        """The known word behind a surface form, or none."""
        lower = surface.casefold()
        forms = (lower, *base_forms(lower), lower.removesuffix("s") if "-" in lower else lower)
        return next((form for form in forms if form in self.words), None)

    def may_be_name(self, name: str) -> bool:
        """Whether a place may be called so without "zone" before it; "a" never is zone A."""
        articles = (word for words in read_lexicon().articles.values() for word in words)
        known = self.word(name)
        return known is None or (self.names_first and known not in articles)


def refuse(text: str, start: int, what: str) -> InputError:
    """The error for a search that is not understood; positions count characters from 1."""
    return InputError(f'search "{text}": position {start + 1}: {what}')


def refused(text: str, start: int, words: str, refusal: Refusal) -> InputError:
    """The error for words that are understood and cannot be answered."""
    what = f'"{words}": {refusal.why}; what comes closest: {refusal.closest}'
    return refuse(text, start, what)


def read_words(text: str, vocabulary: Vocabulary) -> list[Word]:
    """Tokens of a search in their order.

    Raises :class:`InputError` for a word that is not known (with the nearest ones), a sign that
    means nothing here, an empty text, and one of more than :data:`_MOST_WORDS`.
    """
    found: list[Word] = []
    at = 0
    while at < len(text):
        if (name := _name_at(text, at, found, vocabulary)) is not None:
            found.append(name)
            at = name.end
            continue
        match = _TOKEN.match(text, at)
        if match is not None and match.lastgroup == "word":
            if there := _there(match, found):
                found += there
                at = match.end()
                continue
            _check_refused(text, match, vocabulary)
        if match is None:  # a line break, which "." does not match, is space already
            raise refuse(text, at, _NOTHING)
        found += _words_of(match, text, vocabulary)
        at = match.end()
        one = "-".join(word.value for word in found[-2:])
        if one in read_lexicon().joined:
            start = found[-2].start
            found[-2:] = [Word("word", one, start, at, text[start:at])]
    if not found:
        raise InputError('search: it is empty; say for example "person enters vehicle"')
    if len(found) > _MOST_WORDS:
        what = f"{len(found)} words, at most {_MOST_WORDS} are allowed"
        raise InputError(f"search: {what}; split it into several searches")
    return found


def _there(match: re.Match, before: Sequence[Word]) -> list[Word]:
    """ "There" after a zone was named is in it; not in "is there" and the like."""
    zones = [word.value for word in before if word.kind == "zone"]
    if match.group().casefold() != "there" or not zones or before[-1].value in ("be", "and"):
        return []
    start, end = match.span()
    return [Word("word", "in", start, end, "there"), Word("zone", zones[-1], start, end, "there")]


def _check_refused(text: str, match: re.Match, vocabulary: Vocabulary) -> None:
    """Raise for words that are understood and cannot be answered, unless the catalogue has them."""
    if vocabulary.phrases is None:
        return
    is_known = vocabulary.word(match.group()) is not None
    found = refusal_at(text, match.start(), is_known)
    if found is not None and not any(plain(found[0]) in plain(p) for p in vocabulary.phrases):
        raise refused(text, match.start(), *found)


def _words_of(match: re.Match, text: str, vocabulary: Vocabulary) -> list[Word]:
    kind = str(match.lastgroup)
    surface, start, end = match.group(), match.start(), match.end()
    if kind == "space":
        return []
    if kind == "other":
        hint = "a number here is not negative" if surface in "-−" else _NOTHING
        raise refuse(text, start, f'"{surface}": {hint}')
    if kind == "quoted":
        return [_quoted(surface[1:-1], text, start, end, vocabulary)]
    if kind in {"to", "not"}:
        return [Word("word", kind, start, end, surface)]
    if kind in {"word", "unit"}:
        followed = text[end : end + 1].casefold() == "n" and text[end + 1 : end + 2] in "'’"
        whole = _SHORTENED.get(surface.casefold(), surface) if followed else surface
        return _known(whole, text, (start, end), vocabulary)
    if kind == "number" and len(surface) > _MOST_DIGITS:
        raise refuse(text, start, f"a number of more than {_MOST_DIGITS} digits")
    return [Word(kind, surface, start, end, surface)]


def _known(surface: str, text: str, span: tuple[int, int], vocabulary: Vocabulary) -> list[Word]:
    start, end = span
    word = vocabulary.word(surface)
    if word is not None:
        return [Word("word", word, start, end, surface)]
    if "-" in surface:
        parts = re.finditer(r"[^-]+", surface)
        spans = [(start + part.start(), start + part.end()) for part in parts]
        return [word for at in spans for word in _known(text[slice(*at)], text, at, vocabulary)]
    raise refuse(text, start, f'"{surface}" is not a known word{_nearest(surface, vocabulary)}')


def _nearest(surface: str, vocabulary: Vocabulary) -> str:
    names = [name.casefold() for names in vocabulary.places.values() for name in names]
    known = sorted({*vocabulary.words, *names})
    forms = [surface.casefold(), *base_forms(surface.casefold())]
    near = [f'"{word}"' for form in forms for word in get_close_matches(form, known, 3, 0.75)]
    if near:
        return f"; the nearest are {', '.join(dict.fromkeys(near))}"
    return "; none is near; docs/search-language.md lists what may be said"


def _name_at(text: str, at: int, before: list[Word], vocabulary: Vocabulary) -> Word | None:
    """A place's name that begins here: any name after "zone" or "line", else only a name that
    is no word."""
    if at > 0 and text[at - 1].isalnum():
        return None
    places, last = vocabulary.places, before[-1].value if before else ""
    said = next((kind for kind in places if last in read_lexicon().sets[kind]), None)
    found = {kind: _longest(text, at, names) for kind, names in places.items()}
    if said is not None:
        name = found[said]
        if name is None:
            _check_name(text, at, said, vocabulary)
            return None
        return Word(said, name, at, at + len(name), text[at : at + len(name)])
    meant = [(k, name) for k, name in found.items() if name and vocabulary.may_be_name(name)]
    if len(meant) > 1:
        name = meant[0][1]
        both = f'"{name}" is a zone and a line; say "zone {name}" or "line {name}"'
        raise refuse(text, at, both)
    return next((Word(k, n, at, at + len(n), text[at : at + len(n)]) for k, n in meant), None)


def _check_name(text: str, at: int, kind: str, vocabulary: Vocabulary) -> None:
    """Raise for a word after "zone" that is neither a name nor anything else."""
    match = _TOKEN.match(text, at)
    surface, of = (match.group(), match.lastgroup) if match is not None else ("", None)
    if of == "number" or (of == "word" and vocabulary.word(surface) is None):
        raise refuse(text, at, _unknown_name(surface, kind, vocabulary.places[kind]))


def _unknown_name(surface: str, kind: str, names: Sequence[str]) -> str:
    if not names:
        return f'"{surface}" is no {kind}: none has been named'
    near = get_close_matches(surface, names, 3, 0.5) or sorted(names)
    listed = ", ".join(f'"{name}"' for name in near[:10])
    return f'"{surface}" is no {kind}; there are {listed}'


def _longest(text: str, at: int, names: Sequence[str]) -> str | None:
    def stands_here(name: str) -> bool:
        end = at + len(name)
        here = text[at:end].casefold() == name.casefold()
        return bool(name) and here and not text[end : end + 1].isalnum()

    return max(filter(stands_here, names), key=len, default=None)


def _quoted(name: str, text: str, start: int, end: int, vocabulary: Vocabulary) -> Word:
    after_line = text[:start].split()[-1:] == ["line"]
    kinds = ("line", "zone") if after_line else ("zone", "line")
    kind = next((kind for kind in kinds if name in vocabulary.places[kind]), None)
    if kind is None:
        raise refuse(text, start, _unknown_name(name, kinds[0], vocabulary.places[kinds[0]]))
    return Word(kind, name, start, end, name)


# Amounts and times of day ------------------------------------------------------------------------


@dataclass(frozen=True)
class Amount:
    """A distance, duration or speed (``kind``) in metres and seconds, and the size of its last
    unit in these.
    """

    kind: str
    value: float
    unit: Fraction


def read_number(word: str, text: str, start: int) -> Fraction:
    """A number in digits: "3", "3.5", "1,000". Raises :class:`InputError` for other forms."""
    if "," in word and not re.fullmatch(r"\d{1,3}(,\d{3})+(\.\d+)?", word):
        raise refuse(text, start, f'"{word}": write decimals with a point')
    if word.count(".") > 1:
        raise refuse(text, start, f'"{word}" is no number')
    return Fraction(word.replace(",", ""))


def amount_of(kind: str, parts: Sequence[Fraction], text: str, span: tuple[int, int]) -> Amount:
    """The sum of numbers times units, which ``parts`` holds in turn. Raises :class:`InputError`
    where it is nothing, or too much.
    """
    total = sum((n * u for n, u in zip(parts[::2], parts[1::2], strict=True)), Fraction(0))
    said = text[slice(*span)]
    if total > _MOST:
        raise refuse(text, span[0], f'"{said}" is too much for a {kind}')
    if float(total) == 0:
        raise refuse(text, span[0], f'"{said}": a {kind} must be more than nothing')
    return Amount(kind, float(total), parts[-1])


def read_clock(word: str, text: str, start: int) -> float:
    """ "14:05", "9 pm" as seconds from midnight. Raises :class:`InputError` for what is no time."""
    match = _CLOCK.fullmatch(word.strip())
    if match is None:
        raise refuse(text, start, f'"{word}" is no time of day')
    hour = int(match["hour"])
    minute, second = int(match["minute"] or 0), int(match["second"] or 0)
    half = (match["half"] or "").lower()
    ends_day = (hour, minute, second) == (24, 0, 0) and not half
    if minute > 59 or second > 59 or (not 1 <= hour <= 12 if half else hour > 23 and not ends_day):
        raise refuse(text, start, f'"{word}" is no time of day')
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    return 3600.0 * hour + 60.0 * minute + second
