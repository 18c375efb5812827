"""Who is meant by a noun: somebody new, or somebody of whom was spoken before."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

from scene4d.searching.activities.definition import Role
from scene4d.searching.language.lexicon import Lexicon
from scene4d.searching.language.sentences import Noun
from scene4d.searching.language.words import refuse


@dataclass(frozen=True)
class Referent:
    """Somebody in a search: the name of the role, its kind, and the classes that may play it."""

    name: str
    kind: str
    classes: tuple[str, ...]


@dataclass(frozen=True)
class Discourse:
    """Everybody of whom was spoken, the one of the last mention last, and the last subject.

    Values are never changed: readings that are tried and dropped leave no trace.
    """

    text: str
    lexicon: Lexicon
    people: tuple[Referent, ...] = ()
    mentions: tuple[str, ...] = ()
    subject: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def noted(self, note: str) -> "Discourse":
        """With a note to the reader."""
        return self if note in self.notes else replace(self, notes=(*self.notes, note))

    def referent(self, name: str) -> Referent:
        """The one with this name."""
        return next(person for person in self.people if person.name == name)

    def roles(self) -> tuple[Role, ...]:
        """Everybody as roles, in the order in which they came up."""
        return tuple(Role(person.name, person.classes) for person in self.people)

    def mention(self, name: str) -> "Discourse":
        """Somebody is spoken of again."""
        rest = tuple(other for other in self.mentions if other != name)
        return replace(self, mentions=(*rest, name))

    def add(self, kind: str, classes: Sequence[str], wanted: str) -> tuple[str, "Discourse"]:
        """Somebody new, under this name or the next that is free."""
        taken = {person.name for person in self.people}
        name, number = wanted, 2
        while name in taken:
            name, number = f"{kind}_{number}", number + 1
        grown = replace(self, people=(*self.people, Referent(name, kind, tuple(classes))))
        return name, grown.mention(name)

    def narrow(self, name: str, classes: Sequence[str]) -> "Discourse":
        """Somebody known is said to be of these classes."""
        people = tuple(
            replace(person, classes=_common(person.classes, classes))
            if person.name == name
            else person
            for person in self.people
        )
        return replace(self, people=people)

    def meant(
        self, noun: Noun, classes: Sequence[str], besides: Collection[str]
    ) -> tuple[str | None, "Discourse"]:
        """The name of whom a noun refers to among those known, None for somebody new.

        ``classes`` are those that may be meant, ``besides`` names who cannot be: nobody follows
        himself. Raises :class:`InputError` for a pronoun that refers to nobody.
        """
        fitting = [
            name
            for name in self.mentions
            if name not in besides and _fits(self.referent(name), noun, classes)
        ]
        if noun.article == "pronoun" and not fitting:
            raise refuse(self.text, noun.span[0], f'nobody was named whom "{noun.word}" could mean')
        if noun.article == "new" or not fitting:
            return None, self
        if noun.article == "indefinite":
            said = self.text[slice(*noun.span)]
            return None, self.noted(
                f'"{said}" is taken as somebody new; say "the {noun.word}" for {fitting[-1]}'
            )
        if noun.article == "other":
            return (fitting[0] if len(fitting) > 1 else None), self
        subjects = [name for name in self.subject if name in fitting]
        chosen = (subjects or fitting)[-1]
        if len(fitting) > 1:
            others = ", ".join(name for name in fitting if name != chosen)
            said = self.text[slice(*noun.span)]
            return chosen, self.noted(f'"{said}" is taken as {chosen}; it could be {others}')
        return chosen, self


def _fits(referent: Referent, noun: Noun, classes: Sequence[str]) -> bool:
    if noun.kind not in ("any", referent.kind):
        return False
    if noun.classes and not _compatible(referent.classes, noun.classes):
        return False
    return not classes or bool(set(referent.classes) & set(classes))


def _compatible(known: Collection[str], said: Collection[str]) -> bool:
    """A car may be the vehicle named before, a truck is not the car."""
    return set(said) <= set(known) or set(known) <= set(said)


def _common(first: Sequence[str], second: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in first if name in second)
