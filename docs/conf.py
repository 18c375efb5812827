"""The site: make docs, which is sphinx-build -W docs build/site.

Sphinx with MyST reads the pages as they are on the code's host. The two reference pages are made
here, from the command line's own help and from docstrings, so they cannot fall behind. Formulas
become MathML, and no page loads anything from elsewhere.
"""

import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType

import typer
from docutils import nodes
from latex2mathml.converter import convert

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))

project = "scene4d"
author = copyright = "The scene4d authors"  # noqa: A001 - Sphinx's name
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_math_renderer = "mathml"
html_theme = "furo"
html_title = "scene4d"
html_show_sphinx = False
smartquotes = False  # they would make one dash of the two of an option
exclude_patterns = ["images"]
templates_path: list[str] = []
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True}
suppress_warnings = ["myst.strikethrough"]

_MODULES = {
    "scene4d.core.errors": "Errors",
    "scene4d.calibration.options": "Options of `calibrate`",
    "scene4d.tracking._options": "Options of `track` and `watch`",
    "scene4d.searching._asking": "Options of `search`",
    "scene4d.alignment._options": "Options of `align`",
    "scene4d.searching.predicates": "Predicates",
}
"""What the functions of the package take and raise, beside the package itself."""


def setup(app):
    app.add_html_math_renderer("mathml", (_inline_math, None), (_block_math, None))
    app.connect("source-read", _made)


def _inline_math(translator, node: nodes.math) -> None:
    translator.body.append(_mathml(node, "inline"))
    raise nodes.SkipNode


def _block_math(translator, node: nodes.math_block) -> None:
    translator.body.append(_mathml(node, "block"))
    raise nodes.SkipNode


def _mathml(node: nodes.Element, display: str) -> str:
    tex = re.sub(r"\\(arg)\b", r"\\operatorname{\1}", node.astext())
    made = convert(tex, display=display)
    if "\\" in made:
        raise ValueError(f"not known to latex2mathml: {tex}")
    return made.replace("<math ", '<math style="overflow: visible" ', 1)


def _made(_, page: str, source: list[str]) -> None:
    """Put what is generated where a page asks for it."""
    for mark, made in (("<!-- commands -->", _commands), ("<!-- python -->", _python)):
        if mark in source[0]:
            source[0] = source[0].replace(mark, "\n".join(made()))


def _commands() -> Iterator[str]:
    from scene4d.cli.app import app

    for name, command in typer.main.get_command(app).commands.items():
        inner = getattr(command, "commands", {})
        yield from _command(f"scene4d {name}", command)
        for part, one in inner.items():
            yield from _command(f"scene4d {name} {part}", one)


def _command(name: str, command) -> Iterator[str]:
    given = [_word(one) for one in command.params if one.param_type_name == "argument"]
    yield from (f"## `{name}`", "", f"    {name} {' '.join(given)} [OPTIONS]", "")
    yield from _help(command.help or "")
    panels: dict[str, list[str]] = {}
    for one in command.params:
        if not getattr(one, "hidden", False):
            panel = getattr(one, "rich_help_panel", None) or "Arguments and options"
            panels.setdefault(panel, []).append(_row(one))
    for panel, rows in panels.items():
        yield from ("", f"**{panel}**", "", "| | | |", "|---|---|---|", *rows, "")


def _word(argument) -> str:
    return argument.metavar if argument.required else f"[{argument.metavar}]"


def _row(one) -> str:
    names = ", ".join(f"`{name}`" for name in (*one.opts, *one.secondary_opts) if name[0] == "-")
    takes = "" if getattr(one, "is_flag", False) else f"`{one.metavar or one.type.name.upper()}`"
    shown = one.default if one.default not in (None, False, (), []) else None
    facts = ["required"] * bool(one.required) + [f"default {shown}"] * (shown is not None)
    text = _plain(getattr(one, "help", None) or "").replace("|", "\\|")
    return f"| {names} {takes} | {text} | {', '.join(facts)} |"


def _plain(text: str) -> str:
    """Without the terminal's marks, and with angle brackets as text."""
    return re.sub(r"\[/?(?:bold|dim|italic)\]", "", text).replace("<", "&lt;").replace("*", "\\*")


def _help(text: str) -> Iterator[str]:
    """Paragraphs as they are; indented lines are commands."""
    for part in text.split("\n\n"):
        if part.startswith("  "):
            yield from ("```sh", *(line[2:] for line in part.splitlines()), "```", "")
        else:
            yield from (_plain(part), "")


def _python() -> Iterator[str]:
    import scene4d

    yield from ("## The package", "", "```{eval-rst}")
    for name in scene4d.__all__:
        if not name.startswith("_"):
            kind = "class" if isinstance(getattr(scene4d, name), type) else "function"
            yield from (f".. auto{kind}:: scene4d.{name}", "")
    yield "```"
    for module, title in _MODULES.items():
        yield from ("", f"## {title}", "", "```{eval-rst}")
        for name in _public(module):
            yield from (name, "")
        yield "```"


def _public(module: str) -> Iterator[str]:
    """Directives for what a module makes, or a package gives."""
    content = import_module(module)
    for name in getattr(content, "__all__", None) or vars(content):
        value = getattr(content, name)
        where = getattr(value, "__module__", "") or ""
        own = where == module or (hasattr(content, "__all__") and where.startswith("scene4d"))
        if own and isinstance(value, type | FunctionType) and not name.startswith("_"):
            kind = "class" if isinstance(value, type) else "function"
            yield f".. auto{kind}:: {where}.{name}"
