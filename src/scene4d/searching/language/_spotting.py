"""Where another one was: what he did there becomes an activity of its own."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from scene4d.searching.activities.definition import Activity, Spot, Term
from scene4d.searching.language._discourse import Discourse
from scene4d.searching.language._lexicon import StateEntry
from scene4d.searching.language._pieces import Piece, state
from scene4d.searching.language._sentences import (
    Clause,
    Done,
    Lasting,
    Noun,
    Said,
    SpotSaid,
    options_of,
)
from scene4d.searching.predicates._when import When

_ENDS = ("appears", "appears_from", "disappears", "disappears_into")
"""Predicates of a moment, which has a place."""
_SAME = {"same", "his", "her", "its", "their"}
_Read = Callable[[Clause, Discourse], Piece]


def with_spots(clause: Clause, discourse: Discourse, read: _Read) -> Clause:
    """A clause of which the spots are named, and known to the discourse; ``read`` reads what was
    done there. Raises :class:`InputError` for what cannot be asked of another time.
    """

    def named(part: Any) -> Any:
        if isinstance(part, Said | Done):
            part = replace(part, nouns=tuple(map(described, part.nouns)))
        is_spot = isinstance(part, Said) and part.spot is not None
        return _named(part, part.spot, clause, discourse, read) if is_spot else part

    def described(noun: Noun) -> Noun:
        return replace(noun, relatives=tuple(map(named, noun.relatives)))

    subjects, modifiers = map(described, clause.subjects), map(named, clause.modifiers)
    core = named(clause.core)
    return replace(clause, subjects=tuple(subjects), core=core, modifiers=tuple(modifiers))


def _named(said: Said, spot: SpotSaid, clause: Clause, discourse: Discourse, read: _Read) -> Said:
    noun, words = spot.noun, discourse.said(spot.span)
    _check_other(noun, clause, discourse)
    known = Discourse(discourse.text, dict(discourse.people), discourse.mentions)
    if noun.article in ("definite", "other") and known.meant(noun, noun.classes, ()) is not None:
        return _bound(said, spot, discourse, read)
    if noun.word in ("another", "other") and not noun.classes:
        noun = _like_subject(noun, clause, discourse)
    there = Discourse(discourse.text)
    piece = _done_there(replace(spot, noun=noun), there, read)
    name = re.sub(r"[\s(),=]+", " ", re.sub(r"^\w+\s", "", words)).strip()
    doer = there.subject[0]
    made = Activity(name, there.roles(), piece.phases, piece.relations)
    for note in there.notes:
        discourse.note(note)
    discourse.add_spot(
        Spot(name, made, doer, spot.when, _phase(spot, piece)), there.people[doer].kind
    )
    return replace(said, values={**said.values, "spot": name})


def _check_other(noun: Noun, clause: Clause, discourse: Discourse) -> None:
    """Refuse who is, or may be, the one who is there now, and several at once."""
    said = set(discourse.said(noun.span).casefold().split())
    subjects = {one.kind for one in clause.subjects}
    is_same = noun.article == "pronoun" or said & _SAME
    if is_same or (noun.article == "definite" and noun.kind in subjects):
        what = "nobody is compared with himself at another time"
        raise discourse.refuse(noun.span, f'{what}; say "another {noun.kind}"')
    if noun.count > 1:
        what = f'say "another {noun.kind}", or "where people met"'
        raise discourse.refuse(noun.span, f"spots are those of one at a time; {what}")


def _done_there(spot: SpotSaid, there: Discourse, read: _Read) -> Piece:
    lasting = () if spot.lasting is None else (spot.lasting,)
    if spot.core is not None:
        clause = Clause((spot.noun,), spot.polarity, spot.core, lasting, spot.span)
        return read(clause, there)
    name = there.name_of(spot.noun, ())
    there.subject = (name,)
    return state((Term("present", (name,)),), Lasting(None, None, spot.span), False, there)


def _phase(spot: SpotSaid, piece: Piece) -> str | None:
    """The phase in which another one was where is asked for: that in which he appears or is gone,
    the state that the activity names or leads to, else the last; none: all of it.
    """
    for phase in piece.phases:
        if any(term.predicate in _ENDS for term in phase.terms):
            return phase.name
    for option in options_of(spot.core):
        for spoken in option.meant if isinstance(option, Done) else ():
            activity = spoken.activity
            if activity.name == piece.name:
                return activity.state or (piece.phases[-1].name if activity.after else None)
    return piece.phases[-1].name


def _like_subject(noun: Noun, clause: Clause, discourse: Discourse) -> Noun:
    """ "Another" is one as the subject."""
    subjects = clause.subjects
    if not (subjects and subjects[0].classes):
        raise discourse.refuse(noun.span, '"another" what? Say "another person", for example')
    one = subjects[0]
    return replace(noun, kind=one.kind, classes=one.classes, word=one.word)


def _bound(said: Said, spot: SpotSaid, discourse: Discourse, read: _Read) -> Said:
    """Somebody who takes part was there before: he is looked at so much earlier."""
    known = Discourse(discourse.text, dict(discourse.people), discourse.mentions)
    piece = _done_there(spot, known, read)
    is_state = len(piece.phases) == 1 and all(len(term.roles) == 1 for term in piece.terms)
    is_ever = spot.when == When(is_over=True) and not piece.is_timed
    if not (is_state and is_ever) or said.entry.becomes:
        what = '{}: of whom takes part say only what he was, as in "where the car was"'
        raise discourse.refuse(spot.span, what)
    lag = {"lag_s": float("inf")}
    distance = {"tau_m": said.values["distance"]} if "distance" in said.values else {}
    near = Term("near", ("a", "b"), {**distance, **lag})
    was = [term for term in piece.terms if term.predicate != "present"]
    terms = [replace(t, roles=("b",), parameters={**t.parameters, **lag}) for t in was]
    entry = StateEntry((near, *terms))
    return replace(said, entry=entry, nouns=(spot.noun,), values={}, spot=None)
