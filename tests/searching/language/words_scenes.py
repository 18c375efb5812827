"""What the tests of searches in words share."""

from functools import cache

from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.language import parse_query

ZONES = ("entrance", "door", "car park")
LINES = ("gate",)


@cache
def catalogue():
    """The one that is shipped."""
    return load_catalogue()


def parsed(text, zones=ZONES, lines=LINES):
    return parse_query(text, catalogue(), zones, lines)


def state_terms(text):
    """The terms of a search that is one state, as text."""
    query = parsed(text)
    (phase,) = query.activity.phases
    return phase, query.predicates
