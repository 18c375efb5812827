"""Nouns bound to roles, and what is said of them on the way."""

from collections.abc import Collection, Sequence

from scene4d.searching.activities.definition import Term
from scene4d.searching.language.referents import Discourse
from scene4d.searching.language.sentences import Noun, Pair
from scene4d.searching.language.words import refuse


def nouns_of(subject: Noun | Pair | None) -> tuple[Noun, ...]:
    """Those who do it: none, one or two."""
    if isinstance(subject, Pair):
        return subject.first, subject.second
    return () if subject is None else (subject,)


def bound(noun: Noun, discourse: Discourse, besides: Collection[str]) -> tuple[str, Discourse]:
    """The name of a noun's role, of somebody new where nobody known is meant."""
    if noun.article == "reciprocal":
        raise refuse(discourse.text, noun.span[0], '"each other" needs two, such as "two people"')
    name, discourse = discourse.meant(noun, noun.classes, besides)
    discourse = remarked(noun, discourse)
    if name is None:
        return discourse.add(noun.kind, noun.classes, noun.kind)
    if noun.classes:
        discourse = discourse.narrow(name, noun.classes)
    return name, discourse.mention(name)


def remarked(noun: Noun, discourse: Discourse, may_be_plural: bool = False) -> Discourse:
    """With notes where a noun says more, or less, than is searched for."""
    entry = discourse.lexicon.noun(noun.word) if noun.classes else None
    if entry is None:
        return discourse
    if entry.note:
        discourse = discourse.noted(f'"{noun.word}" is taken as any {entry.kind}: {entry.note}')
    if noun.is_plural and not may_be_plural:
        discourse = discourse.noted(
            f'"{discourse.text[slice(*noun.span)]}" is taken as one {noun.kind} at a time'
        )
    if not is_general(noun, discourse):
        *kinds, last = noun.classes
        listed = f"{', '.join(kinds)} and {last}" if kinds else last
        unknown = " of unknown kind" if last == "vehicle" else ""
        discourse = discourse.noted(
            f'"{noun.word}" looks at {listed}{unknown}; say "{noun.kind}" for any'
        )
    return discourse


def is_general(noun: Noun, discourse: Discourse) -> bool:
    """Whether a noun says no more than its kind."""
    of_kind = [entry for entry in discourse.lexicon.nouns if entry.kind == noun.kind]
    widest = max((entry.classes for entry in of_kind), key=len, default=())
    return not noun.classes or len(noun.classes) == len(widest)


def adjective_terms(noun: Noun, name: str, besides: Sequence[str] = ()) -> tuple[Term, ...]:
    """What the words before a noun say of it; ``besides`` are predicates that are said already."""
    return tuple(
        Term(adjective.predicate, (name,), {}, adjective.negated)
        for adjective in noun.adjectives
        if adjective.predicate not in besides
    )
