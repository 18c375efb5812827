"""YAML of untrusted files, as JSON has it: plain values, names that are texts and occur once, and
nothing that grows while it is read.
"""

from typing import Any

import yaml
from yaml.constructor import SafeConstructor

from scene4d.core.errors import InputError
from scene4d.core.text import quoted

_LONGEST = 1 << 22
"""Characters of a document. Camera files take a few thousand, a plan of 10,000 clips a million."""
_TAG = "tag:yaml.org,2002:"
_READ = {
    f"{_TAG}int": SafeConstructor.construct_yaml_int,
    f"{_TAG}float": SafeConstructor.construct_yaml_float,
    f"{_TAG}bool": SafeConstructor.construct_yaml_bool,
    f"{_TAG}null": SafeConstructor.construct_yaml_null,
}
_TEXTS = frozenset({f"{_TAG}str", f"{_TAG}timestamp", f"{_TAG}value"})
"""A date stays the text that it was."""
_MERGE = f"{_TAG}merge"
_LISTS = frozenset({f"{_TAG}seq"})
_MAPPINGS = frozenset({f"{_TAG}map", f"{_TAG}opencv-matrix"})


def compose(text: str) -> yaml.Node | None:
    """The nodes of a document, for readers that name the line of each. Raises :class:`InputError`
    naming the line.
    """
    if len(text) > _LONGEST:
        raise InputError(f"holds {len(text)} characters of YAML; expected at most {_LONGEST}")
    try:
        return yaml.compose(text, Loader=yaml.CSafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise InputError(
            f"line {mark.line + 1 if mark else 1}: is not valid YAML: {quoted(error.problem)}"
        ) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError("the text is not valid YAML") from error


def load_yaml(text: str) -> Any:
    """The values of a document; None of an empty one. Raises :class:`InputError` naming the line,
    also for names that occur twice, tags but OpenCV's, aliases (nine lines of which can stand for
    10⁹ values) and merge keys, which copy them.
    """
    node = compose(text)
    try:
        return None if node is None else _value(node, SafeConstructor(), set())
    except RecursionError as error:
        raise InputError("the text is not valid YAML: too deep") from error


def _value(node: yaml.Node, made: SafeConstructor, seen: set[int]) -> Any:
    if id(node) in seen:
        raise _refused(node, "aliases (*) are not read; write out what they stand for")
    seen.add(id(node))
    if isinstance(node, yaml.ScalarNode) and node.tag in _TEXTS:
        return node.value
    if isinstance(node, yaml.ScalarNode) and node.tag in _READ:
        try:
            return _READ[node.tag](made, node)
        except (ValueError, KeyError, IndexError):
            raise _refused(node, f"is not valid YAML: {quoted(node.value)}") from None
    if isinstance(node, yaml.SequenceNode) and node.tag in _LISTS:
        return [_value(one, made, seen) for one in node.value]
    if not isinstance(node, yaml.MappingNode) or node.tag not in _MAPPINGS:
        raise _refused(node, f"is not valid YAML here: the tag {quoted(node.tag)}")
    found: dict[str, Any] = {}
    for name, value in node.value:
        if name.tag == _MERGE:
            raise _refused(name, "merge keys (<<) are not read")
        if not isinstance(name, yaml.ScalarNode):
            raise _refused(name, "a name must be a text")
        if name.value in found:
            raise _refused(name, f"the name {quoted(name.value)} is there twice")
        found[name.value] = _value(value, made, seen)
    return found


def _refused(node: yaml.Node, why: str) -> InputError:
    return InputError(f"line {node.start_mark.line + 1}: {why}")
