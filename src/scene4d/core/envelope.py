"""The four keys that every JSON object has which the program prints or exports."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any


def envelope(
    name: str,
    fields: Mapping[str, Any],
    *,
    warnings: Sequence[str] = (),
    error: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The object of a command: schema, version, warnings and error, then the command's own keys."""
    head = {
        "schema": f"scene4d/{name}/1",
        "version": version("scene4d"),
        "warnings": list(dict.fromkeys(warnings)),
        "error": error,
    }
    return head | {key: value for key, value in fields.items() if key not in head}
