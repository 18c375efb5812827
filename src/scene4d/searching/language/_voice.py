"""Whether the words of a clause may mean an activity: active or passive, with or without object."""

import re

from scene4d.searching.language._discourse import Discourse
from scene4d.searching.language._refusals import plain
from scene4d.searching.language._sentences import Clause, Done, Said, Spoken

_OF_WHAT = ("leave", "enter", "exit")


def check_voice(spoken: Spoken, clause: Clause, done: Done, discourse: Discourse) -> None:
    """Refuse "is entering" for "is entered"."""
    said = discourse.said(done.span)
    is_active = re.match(r"(?!being)\w+ing\b", said) is not None
    if said.casefold() == "left" and not clause.subjects:
        raise discourse.refuse(done.span, '"left" is a side here, or a past; say "turns left"')
    if spoken.is_passive:
        has_be = clause.polarity.is_state or done.has_be or not spoken.has_subject
        has_doer = any(
            discourse.said(part.span).startswith("by ")
            for part in clause.modifiers
            if isinstance(part, Said)
        )
        is_wrong = is_active or (spoken.needs_be and (has_doer or not has_be))
    else:
        is_wrong = clause.polarity.is_state and not is_active and spoken.has_subject
    if is_wrong:
        raise discourse.refuse(clause.span, f'{spoken.activity.name} is not said "{said}"')


def check_of_what(done: Done, discourse: Discourse) -> None:
    """Refuse a verb that may be done to a vehicle, a place or the view, and to none is said."""
    said = discourse.said(done.span)
    if plain(said) in _OF_WHAT:
        what = f'"{said}" what? Say a vehicle, a zone, or "the scene"'
        raise discourse.refuse(done.span, what)
