"""Catalogues of activities: YAML, read strictly, with the line of whatever is wrong."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import resources
from itertools import chain
from pathlib import Path

import yaml

from scene4d.core.errors import InputError
from scene4d.core.text import nearest
from scene4d.core.yaml_text import compose
from scene4d.searching.activities._checking import (
    check_activity,
    check_durations,
    check_names,
    check_relation,
    check_role,
)
from scene4d.searching.activities._terms import check_term, parse_term
from scene4d.searching.activities.definition import Activity, Phase, Relation, Role, Term

_ACTIVITY = ("description", "phrases", "labels", "roles", "phases", "relations", "state", "after")
_PHASE = ("name", "lasts", "gap", "unseen", "holds")
_BUILT_IN = "catalogue.yaml"
_LONGEST_TEXT = 300
"""Characters, twice what the package's own catalogue needs, so that messages can quote any text."""


def load_catalogue(*paths: str | os.PathLike[str]) -> dict[str, Activity]:
    """The activities that come with the package, and those of the given files, by name.

    Raises :class:`InputError` with file and line for what is not YAML, for keys, predicates, roles,
    classes, parameters and relations that do not exist (naming the nearest), for impossible
    durations, and for a name or a phrase that two activities share.
    """
    found: dict[str, Activity] = {}
    phrases: dict[str, str] = {}
    texts = [(Path(path).name, _read(Path(path))) for path in paths]
    given = (_Reader(name).activities(text) for name, text in texts)
    for activity, place in chain(_shipped(), *given):
        with place():
            if activity.name in found:
                raise InputError(f"the activity {activity.name!r} exists already")
            for phrase in activity.phrases:
                other = phrases.setdefault(phrase.casefold(), activity.name)
                if other != activity.name:
                    raise InputError(f"the phrase {phrase!r} already means {other!r}")
        found[activity.name] = activity
    return found


@cache
def _shipped() -> tuple[tuple[Activity, Callable], ...]:
    """The activities of the package, read once."""
    text = resources.files(__package__).joinpath(_BUILT_IN).read_text("utf-8")
    return tuple(_Reader(_BUILT_IN).activities(text))


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None


class _Reader:
    """One file's nodes as activities; every complaint carries the line of its node."""

    def __init__(self, name: str) -> None:
        self._name = name

    def activities(self, text: str) -> Iterator[tuple[Activity, Callable]]:
        """The activities of the file, each with a context that names its place."""
        try:
            root = compose(text)
        except InputError as error:
            raise InputError(f"{self._name}, {error}") from None
        if root is None:
            raise InputError(f"{self._name}: is empty, expected activities:")
        top = self._mapping(root, ("activities", "classes"))
        for node in self._mapping(top["classes"]).values() if "classes" in top else ():
            self._words(node)
        if "activities" not in top:
            raise InputError(f"{self._name}, line 1: no activities:")
        for name, node in self._mapping(top["activities"]).items():
            yield self._activity(name, node), lambda node=node: self._at(node)

    def _activity(self, name: str, node: yaml.Node) -> Activity:
        given = self._mapping(node, _ACTIVITY, needed=("roles", "phases"))
        roles = tuple(
            self._role(key, value) for key, value in self._mapping(given["roles"]).items()
        )
        names = roles_named = [role.name for role in roles]
        phases = tuple(self._phase(value, names) for value in self._items(given["phases"]))
        names = [phase.name for phase in phases]
        with self._at(node):
            check_names("phase", names)
        activity = Activity(
            name,
            roles,
            phases,
            tuple(self._relation(value, names) for value in self._items(given.get("relations"))),
            self._words(given.get("phrases")),
            self._words(given.get("labels")),
            self._text(given["description"]) if "description" in given else "",
            self._text(given["state"]) if "state" in given else "",
            tuple(self._term(value, roles_named) for value in self._items(given.get("after"))),
        )
        with self._at(node):
            check_activity(activity)
        return activity

    def _role(self, name: str, node: yaml.Node) -> Role:
        role = Role(name, self._words(node))
        with self._at(node):
            check_role(role)
        return role

    def _phase(self, node: yaml.Node, roles: Sequence[str]) -> Phase:
        given = self._mapping(node, _PHASE, needed=("name", "holds"))
        shortest, longest = self._two("lasts", "[shortest, longest]", given, (0.0, float("inf")))
        unseen_s = self._two("unseen", "[before, after]", given, (0.0, 0.0))
        gap = self._number(given["gap"]) if "gap" in given else 0.0
        terms = tuple(self._term(value, roles) for value in self._items(given["holds"]))
        phase = Phase(self._text(given["name"]), terms, shortest, longest, gap, unseen_s)
        with self._at(given.get("lasts" if gap >= 0 else "gap", node)):
            check_durations(phase)
        return phase

    def _two(
        self,
        key: str,
        expected: str,
        given: Mapping[str, yaml.Node],
        default: tuple[float, float],
    ) -> tuple[float, float]:
        if key not in given:
            return default
        numbers = [self._number(value) for value in self._items(given[key])]
        if len(numbers) != 2:
            with self._at(given[key]):
                raise InputError(f"{key}: {len(numbers)} numbers, expected {expected}")
        return numbers[0], numbers[1]

    def _term(self, node: yaml.Node, roles: Sequence[str]) -> Term:
        with self._at(node):
            term = parse_term(self._text(node))
            check_term(term, roles)
        return term

    def _relation(self, node: yaml.Node, phases: Sequence[str]) -> Relation:
        words = [self._text(value) for value in self._items(node)]
        with self._at(node):
            if len(words) != 3:
                raise InputError("relation: expected [phase, relation, phase]")
            relation = Relation(*words)
            check_relation(relation, phases)
        return relation

    @contextmanager
    def _at(self, node: yaml.Node) -> Iterator[None]:
        """Whatever is raised within names the node's line."""
        try:
            yield
        except InputError as error:
            line = node.start_mark.line + 1
            raise InputError(f"{self._name}, line {line}: {error}") from None

    def _mapping(
        self, node: yaml.Node, keys: tuple[str, ...] | None = None, needed: tuple[str, ...] = ()
    ) -> dict[str, yaml.Node]:
        """Keys and values: each key once, no others than ``keys``, and all that are needed."""
        with self._at(node):
            if not isinstance(node, yaml.MappingNode):
                raise InputError(f"expected key: value, found {_kind(node)}")
        found: dict[str, yaml.Node] = {}
        for key_node, value in node.value:
            key = self._text(key_node)
            with self._at(key_node):
                if keys is not None and key not in keys:
                    raise InputError(f"unknown key {key!r}{nearest(key, keys)}")
                if key in found:
                    raise InputError(f"the key {key!r} occurs twice")
            found[key] = value
        for key in needed:
            if key not in found:
                with self._at(node):
                    raise InputError(f"{key} is missing")
        return found

    def _items(self, node: yaml.Node | None) -> list[yaml.Node]:
        if node is None:
            return []
        with self._at(node):
            if not isinstance(node, yaml.SequenceNode):
                raise InputError(f"expected a list, found {_kind(node)}")
        return node.value

    def _words(self, node: yaml.Node | None) -> tuple[str, ...]:
        """A list of words, or one word, or nothing."""
        if isinstance(node, yaml.ScalarNode):
            return (self._text(node),)
        return tuple(self._text(item) for item in self._items(node))

    def _text(self, node: yaml.Node) -> str:
        with self._at(node):
            if not isinstance(node, yaml.ScalarNode) or not node.value.strip():
                raise InputError(f"expected a word, found {_kind(node)}")
            if len(node.value) > _LONGEST_TEXT:
                raise InputError(
                    f"{len(node.value)} characters in one text, expected at most {_LONGEST_TEXT}"
                )
        return node.value

    def _number(self, node: yaml.Node) -> float:
        text = self._text(node)
        with self._at(node):
            try:
                return float(text.replace(".inf", "inf").replace(".nan", "nan"))
            except ValueError:
                raise InputError(f"expected a number of seconds, found {text!r}") from None


def _kind(node: yaml.Node) -> str:
    if isinstance(node, yaml.MappingNode):
        return "key: value"
    return "a list" if isinstance(node, yaml.SequenceNode) else repr(node.value)
