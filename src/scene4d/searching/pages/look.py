"""One colour for each role, in pictures and plots."""

from collections.abc import Iterable

_ROLES = ("#E69F00", "#56B4E9", "#CC79A7", "#009E73")
"""Okabe and Ito (2008): apart under every colour blindness, bright on dark footage."""


def role_colours(roles: Iterable[str]) -> dict[str, str]:
    """The colours of roles in their order."""
    return {role: _ROLES[number % len(_ROLES)] for number, role in enumerate(roles)}
