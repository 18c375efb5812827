"""What a search says, between its words and its activity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from scene4d.searching.activities.definition import Activity, Role
from scene4d.searching.language._lexicon import Adjective, StateEntry
from scene4d.searching.predicates._when import When

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
    they fill; ``has_subject`` where the first of them stands before the verb. ``needs_be`` is said
    in the passive without a doer; ``is_short`` leaves out the last of its slots.
    """

    activity: Activity
    slots: tuple[Slot, ...]
    roles: tuple[str, ...]
    has_subject: bool
    is_passive: bool = False
    needs_be: bool = False
    is_short: bool = False


@dataclass(frozen=True)
class Choice:
    """Several readings of the same words."""

    options: tuple[Any, ...]


@dataclass(frozen=True)
class Noun:
    """Somebody: ``kind`` ("person", "vehicle"; "any" for they), ``classes`` they may have (none
    for a pronoun), how they are introduced (``article``: indefinite, definite, new, bare, pronoun,
    reciprocal, none for nobody), at least how many they are, or ``exactly``, and what else is said
    of them.
    """

    kind: str
    classes: tuple[str, ...]
    article: str
    word: str
    span: Span
    adjectives: tuple[Adjective, ...] = ()
    relatives: tuple["Said", ...] = ()
    is_plural: bool = False
    count: int = 1
    exactly: bool = False


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
class SpotSaid:
    """Where another one was, and when: what he did, None where he only was there."""

    noun: "Noun"
    polarity: Polarity
    core: "Done | Said | Choice | None"
    lasting: "Lasting | None"
    when: When
    span: Span


@dataclass(frozen=True)
class Said:
    """A state of the lexicon: its entry, whom it is about besides the subject, and values in
    metres, seconds or names. ``is_verb`` where it is no relation. ``spot`` is where it is so.
    """

    entry: StateEntry
    nouns: tuple["Noun", ...]
    values: Mapping[str, float | str]
    span: Span
    is_denied: bool = False
    is_verb: bool = False
    spot: "SpotSaid | None" = None

    @property
    def predicate(self) -> str:
        """The first predicate."""
        return self.entry.holds[0].predicate


@dataclass(frozen=True)
class Done:
    """An activity of the catalogue: what its words may mean, and who stands in its slots.

    ``owner`` is whose trunk it is; ``has_be`` where a form of "be" stands within.
    """

    meant: tuple[Spoken, ...]
    nouns: tuple["Noun", ...]
    places: tuple[Place, ...]
    owner: "Noun | None"
    span: Span
    has_be: bool = False


@dataclass(frozen=True)
class Lasting:
    """How long it lasts, seconds."""

    least: float | None = None
    most: float | None = None
    span: Span = (0, 0)

    @property
    def is_said(self) -> bool:
        """Whether anything was said of it."""
        return (self.least, self.most) != (None, None)

    def within(self, least: float, most: float) -> tuple[float, float]:
        """The shortest and longest duration, of which these are usual."""
        if self.most is None:
            return (least if self.least is None else self.least), most
        return (min(least, self.most) if self.least is None else self.least), self.most


@dataclass(frozen=True)
class Bound:
    """How far apart they are, metres, where it is not said again from whom; ``predicate`` is "near"
    or "far".
    """

    metres: float
    predicate: str
    span: Span


@dataclass(frozen=True)
class Delay:
    """How long after what was said before, at most, seconds."""

    seconds: float
    span: Span


_Part = TypeVar("_Part")
_Modifier = Said | Lasting | Bound | Delay


@dataclass(frozen=True)
class Clause:
    """Somebody, one or two of them, does something, or is somehow; without ``core`` it is only
    somebody.
    """

    subjects: tuple["Noun", ...]
    polarity: Polarity
    core: "Done | Said | Choice | None"
    modifiers: tuple["_Modifier", ...]
    span: Span

    def parts(self, kind: type[_Part]) -> list[_Part]:
        """The modifiers of a kind."""
        return [part for part in self.modifiers if isinstance(part, kind)]


@dataclass(frozen=True)
class Joined:
    """Clauses at the same time; ``links`` ("and", "while") stand between them."""

    clauses: tuple["Clause | Choice", ...]
    links: tuple[str, ...]


@dataclass(frozen=True)
class Chain:
    """One after the other; ``pauses`` in seconds, None where nothing was said of it.
    ``is_turned`` where they were said in the opposite order, as with "after".
    """

    steps: tuple["Joined | Choice | Chain", ...]
    pauses: tuple[float | None, ...]
    words: tuple[str, ...]
    is_turned: bool = False


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
    """The kind of noun that a role's players are called by: "any" where all may play it."""
    if "person" not in role.classes:
        return "vehicle"
    return "any" if len(role.classes) > 1 and "car" in role.classes else "person"
