"""Phrases of a catalogue: what stands where in them, and all the ways to say the same."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Activity
from scene4d.searching.language._lexicon import base_forms, read_lexicon
from scene4d.searching.language._sentences import Slot, Spoken, kind_of
from scene4d.searching.language._words import Vocabulary, read_words

PEOPLE = "people"
"""The noun that is a plural by itself."""
_Piece = str | Slot
"""A word, a slot, or a place such as ``{zone}``."""


@dataclass(frozen=True, eq=False)
class _OpenVocabulary(Vocabulary):
    """Words of a phrase that nobody knows yet are taken in their base form."""

    def word(self, surface: str) -> str | None:
        lower = surface.casefold()
        return super().word(surface) or next(iter(base_forms(lower)), lower)


@dataclass(frozen=True)
class _Said:
    """A phrase: its pieces, and the roles of its slots."""

    pieces: list[_Piece]
    roles: tuple[str, ...]

    @property
    def has_subject(self) -> bool:
        """Whether a slot stands first."""
        return isinstance(self.pieces[0], Slot)

    @property
    def rest(self) -> list[_Piece]:
        """The words after the subject."""
        return self.pieces[1:] if self.has_subject else self.pieces

    def spoken(self, activity: Activity, **how: bool) -> Spoken:
        """The activity, said so."""
        slots = tuple(piece for piece in self.pieces if isinstance(piece, Slot))
        return Spoken(activity, slots, self.roles, self.has_subject, **how)


class PhraseReader:
    """Reads phrases with the words of the lexicon."""

    def __init__(self, words: Mapping[str, str]) -> None:
        lexicon = read_lexicon()
        self._vocabulary = _OpenVocabulary(words, None)
        self._adjectives = {word: entry for entry in lexicon.adjectives for word in entry.words}
        articles = {word for words in lexicon.articles.values() for word in words}
        self._silent = articles | set(lexicon.sets["auxiliary"]) | {"be", "do", "have"}
        verbs = [(f"v_{name}", s.words, s.before) for name, s in lexicon.verbs.items()]
        things = [(f"t_{name}", words, ()) for name, words in lexicon.things.items()]
        self._sets = [
            (name, tuple(words), before)
            for name, patterns, before in (*verbs, *things)
            for pattern in patterns
            for words in spelled(pattern)
        ]

    def read(self, activity: Activity, phrase: str) -> Iterator[tuple[Spoken, list[_Piece]]]:
        """What the phrase says, with its words after the subject.

        A phrase is also said in the passive, with "by" and whoever does it or without, and without
        its last slot. Raises :class:`InputError` for a phrase without a verb, and for one that
        speaks of somebody for whom the activity has no role.
        """
        passive, pieces = self._pieces(phrase)
        slots = tuple(piece for piece in pieces if isinstance(piece, Slot))
        said = _Said(pieces, _roles_of(activity, phrase, slots))
        if not any(isinstance(piece, str) and piece[0] != "{" for piece in said.rest):
            raise InputError(f'activity {activity.name!r}: the phrase "{phrase}" has no verb')
        yield said.spoken(activity, is_passive=passive, needs_be=passive), said.rest
        if passive and said.has_subject:
            doer = Slot(kind_of(activity.roles[0]))
            roles = _roles_of(activity, phrase, (*slots, doer))
            with_doer = _Said([*pieces, "by", doer], roles)
            yield with_doer.spoken(activity, is_passive=True), with_doer.rest
        elif said.has_subject:
            yield from self._otherwise(activity, said)

    def _otherwise(
        self, activity: Activity, said: "_Said"
    ) -> Iterator[tuple[Spoken, list[_Piece]]]:
        """A phrase in the active without its last slot, and in the passive."""
        *before, last = said.pieces
        is_short = isinstance(last, Slot) and last.kind != "any" and isinstance(before[-1], str)
        if is_short and len(said.roles) > 1:
            short = _Said(before, said.roles[:-1])
            yield short.spoken(activity, is_short=True), short.rest
        target = self._object_at(said.pieces)
        if target is None or said.pieces[0].pair:  # type: ignore[union-attr]
            return
        doer, *verb = said.pieces[:target]
        goal = said.pieces[target : target + 1]
        rest = said.pieces[target + 1 :]
        if isinstance(goal[0], str):
            goal, rest = said.pieces[target:], []
        first, *others = said.roles
        by = _Said([*goal, *verb, *rest, "by", doer], (*others, first))
        yield by.spoken(activity, is_passive=True), by.rest
        bare = _Said([*goal, *verb, *rest], tuple(others))
        yield bare.spoken(activity, is_passive=True, needs_be=True), bare.rest

    def _object_at(self, pieces: Sequence[_Piece]) -> int | None:
        """Where the object of a phrase stands: a second slot, or a thing at the end."""
        things = {
            word
            for name, words in read_lexicon().things.items()
            if name != "object"
            for word in words
        }
        for at in range(2, len(pieces)):
            piece = pieces[at]
            if isinstance(piece, Slot):
                return at
            if " ".join(str(one) for one in pieces[at:]) in things:
                return at
        return None

    def _pieces(self, phrase: str) -> tuple[bool, list[_Piece]]:
        """Words and slots; articles and auxiliaries say nothing and are left out."""
        pieces: list[_Piece] = []
        adjectives: list[str] = []
        pair = passive = False
        words = [word.value for word in read_words(phrase, self._vocabulary)]
        for word, following in zip(words, [*words[1:], ""], strict=True):
            entry = read_lexicon().noun(word)
            if entry is not None:
                pieces.append(Slot(entry.kind, tuple(adjectives), pair, word == PEOPLE))
                adjectives, pair = [], False
            elif word == "two" and read_lexicon().noun(following):
                pair = True
            elif word in self._adjectives and read_lexicon().noun(following):
                adjectives.append(self._adjectives[word].holds[0].predicate)
            elif word in ("zone", "line"):
                pieces.append("{" + word + "}")
            elif word in self._silent:
                passive |= word in ("is", "be")
            else:
                pieces.append(word)
        if not pieces:
            raise InputError(f'the phrase "{phrase}" says nothing')
        return passive, pieces

    def ways(self, rest: Sequence[_Piece], is_short: bool = False) -> Iterator[tuple[str, ...]]:
        """All ways to say these words, as symbols of the grammar; a plain word is ``<word>``. In
        what ``is_short`` verbs need not stand before what they are limited to.
        """
        if not rest:
            yield ()
            return
        first = rest[0]
        if isinstance(first, Slot) or first.startswith("{"):
            name = "noun" if isinstance(first, Slot) else first.strip("{}")
            yield from ((name, *tail) for tail in self.ways(rest[1:], is_short))
            return
        sets = self._sets_at(tuple(rest), is_short)
        for name, length in sets:
            for tail in self.ways(rest[length:], is_short):
                yield (name, *tail)
                yield from self._separated(name, tail)
        if not sets:
            yield from ((f"<{first}>", *tail) for tail in self.ways(rest[1:], is_short))

    def _separated(self, name: str, tail: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        """ "picks up person" as "picks person up"."""
        if not tail or not tail[0].startswith(("noun", "t_")):
            return
        entry = read_lexicon().verbs.get(name.removeprefix("v_"))
        for words in entry.words if entry else ():
            if words in read_lexicon().separable:
                verb, particle = words.split()
                yield (f"<{verb}>", tail[0], f"<{particle}>", *tail[1:])

    def _sets_at(self, rest: tuple[_Piece, ...], is_short: bool) -> list[tuple[str, int]]:
        """Sets of synonyms that begin here, with how many words they take: the longest only."""
        found: dict[tuple[str, int], None] = {}
        for name, words, before in self._sets:
            if rest[: len(words)] == words and self._fits(
                rest[len(words) :], () if is_short else before
            ):
                found[name, len(words)] = None
        longest = max((length for _, length in found), default=0)
        return [item for item in found if item[1] == longest]

    def _fits(self, rest: tuple[_Piece, ...], before: Sequence[str]) -> bool:
        if not before:
            return True
        if not rest:
            return False
        first = rest[0]
        if isinstance(first, Slot):
            return first.kind in before
        return any(first in read_lexicon().things.get(name, ()) for name in before)


def spelled(pattern: str) -> Iterator[list[str]]:
    """All ways to spell a pattern that has no slots."""
    choices = [
        [*piece.removesuffix("?").split("|"), *([""] if piece.endswith("?") else [])]
        for piece in pattern.split()
    ]
    for words in product(*choices):
        yield [word for word in words if word]


def _roles_of(activity: Activity, phrase: str, slots: Sequence[Slot]) -> tuple[str, ...]:
    """The roles that the slots fill: for each kind in their order, a pair fills two."""
    free = list(activity.roles)
    found: list[str] = []
    for slot in slots:
        for _ in range(2 if slot.pair else 1):
            role = next((role for role in free if kind_of(role) == slot.kind), None)
            if role is None:
                raise InputError(
                    f'activity {activity.name!r}: the phrase "{phrase}" speaks of more of the kind '
                    f"{slot.kind!r} than it has roles"
                )
            free.remove(role)
            found.append(role.name)
    return tuple(found)
