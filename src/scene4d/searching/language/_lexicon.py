"""The words of a search: read from ``lexicon.yaml``, ``states.yaml`` and ``refusals.yaml``, and the
base form of a word.
"""

import gzip
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from importlib.resources import files
from typing import Any

import yaml

from scene4d.searching.activities._terms import parse_term, term_text
from scene4d.searching.activities.definition import Term

_TABLES = ("pronouns", "articles", "things", "sets", "day", "colours", "ways")
_VERB_BEFORE_NOUN = ("VERB", "AUX", "NOUN", "ADJ", "ADV")


@dataclass(frozen=True)
class _NounEntry:
    """Words for whoever may play a role of ``kind``; ``note`` says what they claim too much,
    ``adjective`` what they say of him besides. ``none`` are those for nobody.
    """

    kind: str
    classes: tuple[str, ...]
    words: tuple[str, ...]
    indefinite: tuple[str, ...] = ()
    none: tuple[str, ...] = ()
    note: str = ""
    adjective: str = ""


@dataclass(frozen=True)
class StateEntry:
    """What a clause may say: terms of a, b and c, the patterns of words for them, and how they are
    meant; see the comments of ``states.yaml``.
    """

    holds: tuple[Term, ...]
    example: str = ""
    verb: tuple[str, ...] = ()
    relation: tuple[str, ...] = ()
    by_kinds: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    subject: str = ""
    object: str = ""
    least_s: float | None = None
    becomes: tuple[bool, ...] = ()
    settles: bool = False
    in_turn: bool = False
    instant: bool = False
    mutual: bool = False
    crowd: Term | None = None
    replaces: tuple[str, ...] = ()
    bare: bool = False


@dataclass(frozen=True)
class Adjective:
    """Words before a noun that say something of it: terms of a."""

    holds: tuple[Term, ...]
    words: tuple[str, ...]


@dataclass(frozen=True)
class _VerbSet:
    """Verbs of one meaning; ``before`` limits them to where one of these words comes next."""

    words: tuple[str, ...]
    before: tuple[str, ...] = ()


@dataclass(frozen=True)
class Refusal:
    """What is understood and cannot be answered: the words, why, and what comes closest."""

    words: tuple[str, ...]
    why: str
    closest: str


@dataclass(frozen=True, eq=False)
class Lexicon:
    """The three files as they stand there; see their comments."""

    nouns: tuple[_NounEntry, ...]
    pronouns: Mapping[str, tuple[str, ...]]
    articles: Mapping[str, tuple[str, ...]]
    things: Mapping[str, tuple[str, ...]]
    verbs: Mapping[str, _VerbSet]
    separable: tuple[str, ...]
    joined: tuple[str, ...]
    sets: Mapping[str, tuple[str, ...]]
    adjectives: tuple[Adjective, ...]
    colours: Mapping[str, tuple[str, ...]]
    states: tuple[StateEntry, ...]
    refusals: tuple[Refusal, ...]
    units: Mapping[str, tuple[tuple[Fraction, tuple[str, ...]], ...]]
    numbers: tuple[tuple[Fraction, tuple[str, ...]], ...]
    clock: Mapping[str, str]
    day: Mapping[str, tuple[str, str]]
    assumed: Mapping[str, float]
    ways: Mapping[str, tuple[str, ...]]

    def noun(self, word: str) -> _NounEntry | None:
        """The entry that has this word."""
        return next((entry for entry in self.nouns if word in entry.words), None)

    def adjective(self, word: str) -> Adjective:
        """The adjective that has this word."""
        return next(entry for entry in self.adjectives if word in entry.words)


def state_examples() -> list[tuple[str, str]]:
    """The predicates of each state of the lexicon as text, and a search for it."""
    states = read_lexicon().states
    return [(" and ".join(map(term_text, entry.holds)), entry.example) for entry in states]


def ways_to_say() -> Mapping[str, tuple[str, ...]]:
    """What else can be said, beside or between activities and states, with examples."""
    return read_lexicon().ways


@cache
def base_forms(word: str) -> tuple[str, ...]:
    """Base forms of a word in lower case, those of a verb first; none where nobody knows it.

    From the dictionary of LemmInflect, which is part of its installation; its guesses for words
    that are not in there are not used, since a guess would hide a spelling mistake.
    """
    found: dict[str, list[str]] = {}
    for line in _entries(word):
        _, part, forms = line.split(",")
        found["AUX" if part == "modal" else part.upper()] = forms.lower().split("/")
    ordered = [form for part in _VERB_BEFORE_NOUN for form in found.get(part, ())]
    return tuple(dict.fromkeys(form for form in ordered if form != word))


def _entries(word: str) -> list[str]:
    """The dictionary's lines of a word, ``word,part of speech,base form/...``, then one that
    overrides them.
    """
    lines, first, overriding = _dictionary()
    at = end = first.get(word, len(lines))
    while end < len(lines) and lines[end].startswith(f"{word},"):
        end += 1
    return [*lines[at:end], *overriding.get(word, ())]


@cache
def _dictionary() -> tuple[list[str], dict[str, int], dict[str, list[str]]]:
    """Its lines, those of a word one after the other; the first line of each word; and the lines
    that override others. LemmInflect itself takes ten times as long to read them.
    """
    import lemminflect

    folder = files(lemminflect) / "resources"
    packed = (folder / "lemma_lu.csv.gz").read_bytes()
    lines = gzip.decompress(packed).decode().splitlines()
    words = [line.partition(",")[0] for line in reversed(lines)]
    first = dict(zip(words, range(len(lines) - 1, -1, -1), strict=True))
    overriding: dict[str, list[str]] = {}
    for line in (folder / "lemma_overrides.csv").read_text("utf-8").splitlines():
        if line and not line.startswith("#"):
            overriding.setdefault(line.partition(",")[0], []).append(line)
    return lines, first, overriding


@cache
def read_lexicon() -> Lexicon:
    """The lexicon of this package."""
    data = _yaml("lexicon.yaml")
    return Lexicon(
        nouns=tuple(_NounEntry(**_tuples(entry)) for entry in data["nouns"]),
        verbs={name: _verb_set(value) for name, value in data["verbs"].items()},
        separable=tuple(data["separable"]),
        joined=tuple(data["joined"]),
        adjectives=tuple(Adjective(**_tuples(_terms(entry))) for entry in data["adjectives"]),
        states=tuple(StateEntry(**_tuples(_terms(entry))) for entry in _yaml("states.yaml")),
        refusals=tuple(Refusal(**_tuples(entry)) for entry in _yaml("refusals.yaml")),
        units={name: _by_factor(table) for name, table in data["units"].items()},
        numbers=_by_factor(data["numbers"]),
        **{name: _tuples(data[name]) for name in _TABLES},
        assumed={name: float(value) for name, value in data["assumed"].items()},
        clock=data["clock"],
    )


def _yaml(name: str) -> Any:
    text = files(__package__).joinpath(name).read_text("utf-8")
    return _with_floats(yaml.load(text, Loader=yaml.CSafeLoader))  # safe, and ten times as fast


def _with_floats(value: Any) -> Any:
    """The same with whole numbers as floats."""
    if isinstance(value, dict):
        return {key: _with_floats(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_with_floats(one) for one in value]
    return float(value) if type(value) is int else value


def _terms(entry: Mapping) -> dict:
    """An entry with its texts of predicates as terms."""
    read = {key: entry[key] for key in ("holds", "crowd") if key in entry}
    return {**entry, **{key: _term(value) for key, value in read.items()}}


def _term(value: Any) -> Any:
    return [_term(one) for one in value] if isinstance(value, list) else parse_term(value)


def _tuples(entry: Mapping) -> dict:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()}


def _verb_set(value: list[str] | dict[str, list[str]]) -> _VerbSet:
    return _VerbSet(**_tuples(value)) if isinstance(value, dict) else _VerbSet(tuple(value))


def _by_factor(
    table: Mapping[str, Iterable[str]],
) -> tuple[tuple[Fraction, tuple[str, ...]], ...]:
    return tuple((Fraction(factor), tuple(words)) for factor, words in table.items())
