"""YAML as JSON has it: texts, numbers, lists, and names that occur once. Aliases are refused."""

from pathlib import Path
from typing import Any

import yaml

from scene4d.core.errors import InputError
from scene4d.core.text import quoted, read_text

_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "bool", "null")}
_MOST_CHARACTERS = 10_000_000
"""A plan of 10,000 clips, each named, has a tenth of this."""


def read_yaml(path: Path) -> Any:
    """The content of a file; raises :class:`InputError` with file and line for what is no YAML, and
    for names that occur twice, aliases (a few of which can stand for billions of values) and tags.
    """
    try:
        text = read_text(path)
        if len(text) > _MOST_CHARACTERS:
            raise InputError(f"is longer than {_MOST_CHARACTERS:,} characters")
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        return None if node is None else _value(node, loader, set())
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        raise InputError(f"{path}: {line}is not YAML: {error.problem}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not YAML: {quoted(str(error))}") from None


def _value(node: yaml.Node, loader: yaml.SafeLoader, seen: set[int]) -> Any:
    where = f"line {node.start_mark.line + 1}"
    if id(node) in seen:
        raise InputError(f"{where}: *alias is not read here; write it out")
    seen.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        return [_value(one, loader, seen) for one in node.value]
    if isinstance(node, yaml.MappingNode):
        found: dict[str, Any] = {}
        for name, value in node.value:
            if not isinstance(name, yaml.ScalarNode):
                raise InputError(f"{where}: a name must be a text")
            if name.value in found:
                raise InputError(f"{where}: the name {quoted(name.value)} is there twice")
            found[name.value] = _value(value, loader, seen)
        return found
    # A date stays the text that it was.
    return loader.construct_object(node) if node.tag in _TAGS else node.value
