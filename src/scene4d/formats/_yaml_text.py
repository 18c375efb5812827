"""YAML of untrusted files: plain values only, and nothing that grows while it is read."""

from typing import Any

import yaml
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError

from scene4d.core.errors import InputError
from scene4d.core.text import quoted

_LONGEST = 1 << 20
"""Characters of one document; camera files take a few thousand."""


class _Plain(yaml.CSafeLoader):
    """Safe YAML that also knows OpenCV's matrix tag."""


class _Careful(Composer, _Plain):
    """With Python's composer, which is slower and can refuse aliases and merge keys.

    An alias refers to what stands elsewhere, so that nine lines of nested aliases stand for 10⁹
    values; merge keys copy them. No camera or annotation tool writes either.
    """

    def __init__(self, stream: str) -> None:
        _Plain.__init__(self, stream)
        Composer.__init__(self)

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark: Any = self.get_event()
            raise ComposerError(None, None, "aliases (*) are not read", mark.start_mark)
        return super().compose_node(parent, index)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                raise ConstructorError(None, None, "merge keys (<<) are not read", key.start_mark)


def _opencv_matrix(loader: yaml.CSafeLoader, node: Any) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Plain.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)


def load_yaml(text: str) -> Any:
    """The values of a YAML document. Raises :class:`InputError` naming the line."""
    if len(text) > _LONGEST:
        raise InputError(f"holds {len(text)} characters of YAML; expected at most {_LONGEST}")
    suspect = "*" in text or "<<" in text
    try:
        return yaml.load(text, Loader=_Careful if suspect else _Plain)  # both are safe loaders
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError(f"line {line}: is not valid YAML: {quoted(error.problem)}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError("is not valid YAML") from error
