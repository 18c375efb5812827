"""The words of a search: read from ``lexicon.yaml``, and the base form of a word."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from importlib.resources import files

import yaml

_VERB_BEFORE_NOUN = ("VERB", "AUX", "NOUN", "ADJ", "ADV")


@dataclass(frozen=True)
class _NounEntry:
    """Words for whoever may play a role of ``kind``; ``note`` says what they claim too much."""

    kind: str
    classes: tuple[str, ...]
    words: tuple[str, ...]
    indefinite: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class StateEntry:
    """What a clause may say: a predicate, the patterns of words for it, and where values go."""

    predicate: str
    verb: tuple[str, ...] = ()
    relation: tuple[str, ...] = ()
    values: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    of_object: str = ""
    subject: str = ""
    replaces: tuple[str, ...] = ()
    negated: bool = False
    instant: bool = False
    becomes: bool = False


@dataclass(frozen=True)
class Adjective:
    """Words before a noun that say a predicate of it."""

    predicate: str
    words: tuple[str, ...]
    negated: bool = False


@dataclass(frozen=True)
class _VerbSet:
    """Verbs of one meaning; ``before`` limits them to where one of these words comes next."""

    words: tuple[str, ...]
    before: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Lexicon:
    """``lexicon.yaml`` as it stands there; see the comments of that file."""

    nouns: tuple[_NounEntry, ...]
    pronouns: Mapping[str, tuple[str, ...]]
    articles: Mapping[str, tuple[str, ...]]
    things: Mapping[str, tuple[str, ...]]
    verbs: Mapping[str, _VerbSet]
    separable: tuple[str, ...]
    joined: tuple[str, ...]
    sets: Mapping[str, tuple[str, ...]]
    adjectives: tuple[Adjective, ...]
    states: tuple[StateEntry, ...]
    refused: Mapping[str, str]
    notes: Mapping[str, str]
    units: Mapping[str, tuple[tuple[Fraction, tuple[str, ...]], ...]]
    numbers: tuple[tuple[Fraction, tuple[str, ...]], ...]
    clock: Mapping[str, str]
    day: Mapping[str, tuple[str, str]]
    assumed: Mapping[str, float]

    def noun(self, word: str) -> _NounEntry | None:
        """The entry that has this word."""
        return next((entry for entry in self.nouns if word in entry.words), None)


@cache
def base_forms(word: str) -> tuple[str, ...]:
    """Base forms of a word in lower case, those of a verb first; none where nobody knows it.

    From the dictionary of LemmInflect, which is part of its installation; its guesses for words
    that are not in there are not used, since a guess would hide a spelling mistake.
    """
    from lemminflect import getAllLemmas  # type: ignore[import-untyped]  # slow to load

    found = getAllLemmas(word)
    ordered = [form for part in _VERB_BEFORE_NOUN for form in found.get(part, ())]
    return tuple(dict.fromkeys(form for form in ordered if form != word))


@cache
def read_lexicon() -> Lexicon:
    """The lexicon of this package."""
    text = files(__package__).joinpath("lexicon.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    return Lexicon(
        nouns=tuple(_NounEntry(**_tuples(entry)) for entry in data["nouns"]),
        verbs={name: _verb_set(value) for name, value in data["verbs"].items()},
        separable=tuple(data["separable"]),
        joined=tuple(data["joined"]),
        adjectives=tuple(Adjective(**_tuples(entry)) for entry in data["adjectives"]),
        states=tuple(StateEntry(**_tuples(entry)) for entry in data["states"]),
        units={name: _by_factor(table) for name, table in data["units"].items()},
        numbers=_by_factor(data["numbers"]),
        **{name: _tuples(data[name]) for name in ("pronouns", "articles", "things", "sets", "day")},
        assumed={name: float(value) for name, value in data["assumed"].items()},
        **{name: data[name] for name in ("refused", "notes", "clock")},
    )


def _tuples(entry: Mapping) -> dict:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()}


def _verb_set(value: list[str] | dict[str, list[str]]) -> _VerbSet:
    return _VerbSet(**_tuples(value)) if isinstance(value, dict) else _VerbSet(tuple(value))


def _by_factor(
    table: Mapping[str, Iterable[str]],
) -> tuple[tuple[Fraction, tuple[str, ...]], ...]:
    return tuple((Fraction(factor), tuple(words)) for factor, words in table.items())
