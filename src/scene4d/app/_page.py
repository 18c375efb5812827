"""The page: its template, style and modules put together with the data, in one file."""

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from scene4d.app._footage import Footage
from scene4d.drawing.page import rendered

MODULES = (
    *("packed", "camera", "tracks", "state", "viewport", "cached", "look", "scenery", "flow"),
    *("run", "picture", "plan", "timeline", "clock", "pieces", "geo", "tools", "places", "judge"),
    *("media", "tables", "panel", "search", "alerts", "again", "live", "fleet", "keys", "main"),
)
"""In the order in which one may use another; each is ``templates/NAME.js``."""
_IMPORT = re.compile(r"^import [^;]*;\n", re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|function\*?|class) ([\w$]+))", re.MULTILINE)


def asset(name: str) -> str:
    """A file of the front end."""
    return (files("scene4d.app") / "templates" / name).read_text(encoding="utf-8")


def script() -> str:
    """All modules as one, each in a scope of its own; what they export is known to all others."""
    return '"use strict";\n' + "\n".join(_scoped(asset(f"{name}.js")) for name in MODULES)


def _scoped(code: str) -> str:
    names = ", ".join(found[2] for found in _EXPORT.finditer(code))
    inner = _EXPORT.sub(r"\1", _IMPORT.sub("", code))
    return f"const {{ {names} }} = (() => {{\n{inner}\nreturn {{ {names} }};\n}})();"


def page_html(contents: dict[str, Any], media: Sequence[Footage] = ()) -> str:
    """The page of ``contents``; ``media`` are what its runs show, in their order.

    Its policy allows its own script and style and nothing from any address; only what
    ``contents["api"]`` names may be asked for, at the address that the page came from.
    """
    code, style = script(), asset("page.css")
    asks = "'self'" if contents.get("api") else "'none'"
    policy = (
        f"default-src 'none'; script-src '{_digest(code)}'; style-src '{_digest(style)}'; "
        f"img-src data: blob: {asks if contents.get('api') else ''}; "
        f"media-src data: blob: {asks if contents.get('api') else ''}; connect-src {asks}; "
        "base-uri 'none'; form-action 'none'"
    )
    return rendered(
        "scene4d.app",
        "page.html.j2",
        {
            "policy": " ".join(policy.split()),
            "title": contents["title"],
            "style": style,
            "code": code,
            "data": _in_script(json.dumps(contents, allow_nan=False)),
            "media": [(n, kind, text) for n, one in enumerate(media) for kind, text in _parts(one)],
        },
    )


def _parts(footage: Footage) -> list[tuple[str, str]]:
    there = {"view": footage.view, "video": footage.video}
    return [(kind, base64.b64encode(data).decode()) for kind, data in there.items() if data]


def _in_script(text: str) -> str:
    """JSON that cannot end the element it is in, nor open a comment."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
