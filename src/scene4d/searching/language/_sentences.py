"""What a search says, between its words and its activity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from scene4d.searching.activities.definition import Activity, Role
from scene4d.searching.language._lexicon import Adjective, StateEntry

Span = tuple[int, int]
"""Characters of the text, from the first up to the second."""


@dataclass(frozen=True)
class Slot:
    """A place in a phrase where somebody stands: the kind of noun, what adjectives it has, whether
    it is two of them, and whether it is "people".
    """

    kind: str
    adjectives: tuple[str, ...] = ()
    pair: bool = False
    is_plural: bool = False


@dataclass(frozen=True)
class Spoken:
    """An activity as one of its phrases says it: the slots in their order, and the roles that
    they fill; ``has_subject`` where the first of them stands before the verb.
    """

    activity: Activity
    slots: tuple[Slot, ...]
    roles: tuple[str, ...]
    has_subject: bool


@dataclass(frozen=True)
class Choice:
    """Several readings of the same words."""

    options: tuple[Any, ...]


@dataclass(frozen=True)
class Noun:
    """Somebody: ``kind`` ("person", "vehicle"; "any" for they), ``classes`` they may have (none
    for a pronoun), how they are introduced (``article``: indefinite, definite, new, bare, pronoun,
    reciprocal) and what else is said of them.
    """

    kind: str
    classes: tuple[str, ...]
    article: str
    word: str
    span: Span
    adjectives: tuple[Adjective, ...] = ()
    relatives: tuple["Said", ...] = ()
    is_plural: bool = False


@dataclass(frozen=True)
class Pair:
    """Two subjects."""

    first: "Noun"
    second: "Noun"


@dataclass(frozen=True)
class Place:
    """A zone or a line; without a name where only "the zone" is said."""

    kind: str
    name: str | None
    span: Span


@dataclass(frozen=True)
class Polarity:
    """Auxiliaries and "not"; ``is_state`` for a form of "be" before the verb."""

    is_denied: bool
    is_state: bool


@dataclass(frozen=True)
class Said:
    """A state of the lexicon: its entry, whom it is about besides the subject, and values in
    metres, seconds or names.
    """

    entry: StateEntry
    nouns: tuple["Noun", ...]
    values: Mapping[str, float | str]
    span: Span
    is_denied: bool = False

    @property
    def is_negated(self) -> bool:
        """Whether the predicate's opposite is meant."""
        return self.entry.negated != self.is_denied


@dataclass(frozen=True)
class Done:
    """An activity of the catalogue: what its words may mean, and who stands in its slots.

    ``owner`` is whose trunk it is.
    """

    meant: tuple[Spoken, ...]
    nouns: tuple["Noun", ...]
    places: tuple[Place, ...]
    owner: "Noun | None"
    span: Span


@dataclass(frozen=True)
class Lasting:
    """How long it lasts, seconds."""

    least: float | None
    most: float | None
    span: Span


@dataclass(frozen=True)
class Bound:
    """How far apart they are, metres, where it is not said again from whom; ``predicate`` is "near"
    or "far".
    """

    metres: float
    predicate: str
    span: Span


_Modifier = Said | Lasting | Bound


@dataclass(frozen=True)
class Clause:
    """Somebody does something, or is somehow."""

    subject: "Noun | Pair | None"
    polarity: Polarity
    core: "Done | Said | Choice"
    modifiers: tuple["_Modifier", ...]
    span: Span


@dataclass(frozen=True)
class Joined:
    """Clauses at the same time; ``links`` ("and", "while") stand between them."""

    clauses: tuple["Clause | Choice", ...]
    links: tuple[str, ...]


@dataclass(frozen=True)
class Chain:
    """One after the other; ``pauses`` in seconds, None where nothing was said of it."""

    steps: tuple["Joined | Choice | Chain", ...]
    pauses: tuple[float | None, ...]
    words: tuple[str, ...]


@dataclass(frozen=True)
class Clock:
    """A time of day: from ``begin`` to ``end``, seconds from midnight, either may be missing;
    ``at`` for a single time.
    """

    begin: float | None
    end: float | None
    at: float | None
    span: Span


@dataclass(frozen=True)
class Sentence:
    """The whole search."""

    order: "Chain | Choice"
    clocks: tuple[Clock, ...]


def options_of(node: Any) -> Sequence[Any]:
    """The readings of a node; itself where it has one."""
    return node.options if isinstance(node, Choice) else (node,)


def kind_of(role: Role) -> str:
    """The kind of noun that a role's players are called by."""
    return "person" if "person" in role.classes else "vehicle"
