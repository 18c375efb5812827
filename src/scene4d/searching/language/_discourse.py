"""Who is meant by a noun: somebody new, or somebody named before; and what the reader is told."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Role, Spot, Term
from scene4d.searching.language._lexicon import read_lexicon
from scene4d.searching.language._sentences import Noun, Span
from scene4d.searching.language._words import refuse

NOBODY = (
    "of nobody only a state can be asked for, by itself; what comes closest: "
    '"nobody is in zone NAME for 5 minutes", "nobody is near a vehicle"'
)
_Option = TypeVar("_Option")
_Meant = TypeVar("_Meant")


@dataclass(frozen=True)
class _Referent:
    """Somebody in a search: the role that he plays, and his kind."""

    role: Role
    kind: str

    @property
    def classes(self) -> tuple[str, ...]:
        """Who may play it."""
        return self.role.classes


@dataclass
class Discourse:
    """Everybody named so far, in order; their names with the last mentioned last; the last subject;
    those who were needed and not named (``unsaid``), whom the next noun may name; notes to the
    reader; ``spots``, and of what kind those were who were there (``elsewhere``). A
    reading that is only tried works on a copy (:meth:`trying`).
    """

    text: str
    people: dict[str, _Referent] = field(default_factory=dict)
    mentions: tuple[str, ...] = ()
    subject: tuple[str, ...] = ()
    unsaid: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    spots: tuple[Spot, ...] = ()
    elsewhere: Mapping[str, str] = field(default_factory=dict)

    def said(self, span: Span) -> str:
        """The words of the search at these characters."""
        return self.text[slice(*span)]

    def refuse(self, span: Span, what: str) -> InputError:
        """The error for these words, which stand in it for "{}"."""
        return refuse(self.text, span[0], what.replace("{}", f'"{self.said(span)}"'))

    def assumed(self, name: str) -> float:
        """Seconds that nobody said."""
        return read_lexicon().assumed[name]

    def note(self, note: str, span: Span = (0, 0)) -> None:
        """Tell the reader, once; "{}" stands for the words at these characters."""
        note = note.replace("{}", f'"{self.said(span)}"')
        if note not in self.notes:
            self.notes = (*self.notes, note)

    def trying(
        self, options: Iterable[_Option], read: Callable[[_Option, "Discourse"], _Meant]
    ) -> list[tuple[_Option, _Meant, "Discourse"]]:
        """What each option means, with the discourse after it; raises where none makes sense."""
        found: list[tuple[_Option, _Meant, Discourse]] = []
        failed: list[InputError] = []
        for option in options:
            known = copy(self)
            known.people = dict(self.people)
            try:
                found.append((option, read(option, known), known))
            except InputError as error:
                failed.append(error)
        if not found:
            raise failed[0]
        return found

    def adopt(self, known: "Discourse") -> None:
        """Go on from the discourse after the reading that was chosen."""
        self.__dict__.update(known.__dict__)

    def roles(self) -> tuple[Role, ...]:
        """Everybody as roles, in the order in which they came up."""
        return tuple(one.role for one in self.people.values())

    def mention(self, name: str) -> None:
        """Somebody is spoken of again."""
        self.mentions = (*(other for other in self.mentions if other != name), name)

    def add(self, kind: str, classes: Sequence[str], wanted: str, **how: Any) -> str:
        """Somebody new, under this name or the next that is free; ``how`` many as in a role."""
        name, number = wanted, 2
        while name in self.people:
            name, number = f"{kind}_{number}", number + 1
        self.people[name] = _Referent(Role(name, tuple(classes), **how), kind)
        self.mention(name)
        return name

    def add_usual(self, kind: str) -> str:
        """Somebody of a kind of whom nothing is said."""
        name = self.add(kind, read_lexicon().noun(kind).classes, kind)  # type: ignore[union-attr]
        self.unsaid = (*self.unsaid, name)
        return name

    def add_nobody(self, noun: Noun) -> str:
        """The role that nobody plays; raises :class:`InputError` beside somebody who plays one."""
        if self.people:
            raise self.refuse(noun.span, NOBODY)
        wanted = {"person": "nobody", "any": "nothing"}.get(noun.kind, f"no_{noun.kind}")
        return self.add(noun.kind, noun.classes, wanted, absent=True)

    def add_spot(self, spot: Spot, kind: str) -> None:
        """Where another one of a kind was."""
        if spot not in self.spots:
            self.spots = (*self.spots, spot)
        self.elsewhere = {**self.elsewhere, spot.name: kind}

    def narrow(self, name: str, classes: Sequence[str]) -> None:
        """Somebody known is said to be of these classes."""
        person = self.people[name]
        common = tuple(one for one in person.classes if one in classes)
        self.people[name] = replace(person, role=replace(person.role, classes=common))

    def name_of(self, noun: Noun, besides: Collection[str]) -> str:
        """The name of a noun's role, of somebody new where nobody known is meant."""
        if noun.article == "reciprocal":
            raise self.refuse(noun.span, '"each other" needs two, such as "two people"')
        if noun.word == "another":  # it is one as the last that was named
            if not self.mentions:
                raise self.refuse(noun.span, '"another" what? Say "another person", for example')
            last = self.people[self.mentions[-1]]
            noun = replace(noun, kind=last.kind, classes=last.classes)
        name = self.meant(noun, noun.classes, besides)
        self.remark(noun)
        if name is None:
            wanted = "anything" if noun.kind == "any" else noun.kind
            how = {"count": noun.count, "exactly": noun.exactly}
            return self.add(noun.kind, noun.classes, wanted, **how)
        if noun.count not in (1, self.people[name].role.count):
            raise self.refuse(noun.span, f"{name} was named before, and so many were not")
        if noun.classes:
            self.narrow(name, noun.classes)
        self.mention(name)
        return name

    def meant(self, noun: Noun, classes: Sequence[str], besides: Collection[str]) -> str | None:
        """The name of whom a noun refers to among those known, None for somebody new.

        ``classes`` are those that may be meant, ``besides`` names who cannot be: nobody follows
        himself. Raises :class:`InputError` for a pronoun that refers to nobody.
        """
        fitting = [
            name
            for name in self.mentions
            if name not in besides and _fits(self.people[name], noun, classes)
        ]
        if noun.article == "pronoun" and not fitting:
            raise self.refuse(noun.span, f'nobody was named whom "{noun.word}" could mean')
        if noun.article == "none":
            raise self.refuse(noun.span, NOBODY)
        if noun.article == "definite" and not fitting and noun.kind in self.elsewhere.values():
            what = f'"{noun.word}" was there at another time, and is not followed to this one'
            raise self.refuse(noun.span, f'{what}; say "a {noun.word}" for any')
        if noun.article == "new" or not fitting:
            return None
        if noun.article == "indefinite" and fitting[-1] in self.unsaid:
            return fitting[-1]
        if noun.article == "indefinite":
            who = f'say "the {noun.word}" for {fitting[-1]}'
            self.note(f"{{}} is taken as somebody new; {who}", noun.span)
            return None
        if noun.article == "other":
            return fitting[0] if len(fitting) > 1 else None
        chosen = ([name for name in self.subject if name in fitting] or fitting)[-1]
        if len(fitting) > 1:
            others = ", ".join(name for name in fitting if name != chosen)
            self.note(f"{{}} is taken as {chosen}; it could be {others}", noun.span)
        return chosen

    def remark(self, noun: Noun, may_be_plural: bool = False) -> None:
        """Note where a noun says more, or less, than is searched for."""
        entry = read_lexicon().noun(noun.word) if noun.classes else None
        if entry is None:
            return
        if entry.note:
            self.note(f'"{noun.word}" is taken as any {entry.kind}: {entry.note}')
        if noun.count > 1 and not noun.exactly:
            self.note(f"{{}} is taken as at least {noun.count} at the same time", noun.span)
        elif noun.is_plural and not (may_be_plural or noun.exactly):
            self.note(f"{{}} is taken as one {noun.kind} at a time", noun.span)
        if not self.is_general(noun):
            *kinds, last = noun.classes
            listed = f"{', '.join(kinds)} and {last}" if kinds else last
            unknown = " of unknown kind" if last == "vehicle" else ""
            self.note(f'"{noun.word}" looks at {listed}{unknown}; say "{noun.kind}" for any')

    def is_general(self, noun: Noun) -> bool:
        """Whether a noun says no more than its kind."""
        of_kind = [entry.classes for entry in read_lexicon().nouns if entry.kind == noun.kind]
        return not noun.classes or len(noun.classes) == max(map(len, of_kind))


def adjective_terms(noun: Noun, name: str, besides: Sequence[str] = ()) -> tuple[Term, ...]:
    """What the words before a noun say of it; ``besides`` are predicates that are said already."""
    return tuple(
        replace(term, roles=(name,))
        for adjective in noun.adjectives
        for term in adjective.holds
        if term.predicate not in besides
    )


def _fits(referent: _Referent, noun: Noun, classes: Sequence[str]) -> bool:
    """Whether somebody known may be meant: a car may be the vehicle, a truck is not the car."""
    if noun.kind not in ("any", referent.kind):
        return False
    known, said = set(referent.classes), set(noun.classes)
    if said and not (said <= known or known <= said):
        return False
    return not classes or bool(known & set(classes))
