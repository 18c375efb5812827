"""How large the house is: ``python benchmarks/house.py`` prints the figures of ARCHITECTURE.md.

A public name is a function or class at the top level of a module, without an underscore in front of
it or of any part of the module's path: another room may use it. Lines are all lines of a file;
functions are measured from ``def`` to their last line, methods too.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "scene4d"
SMALL, LARGE = 60, 400
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)


def public_names(path: Path, tree: ast.Module) -> Iterator[str]:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    if any(part.startswith("_") and part != "__init__" for part in parts):
        return
    for node in tree.body:
        if isinstance(node, (*FUNCTION, ast.ClassDef)) and not node.name.startswith("_"):
            yield node.name


def main() -> None:
    rooms: dict[str, list[int]] = {}
    lengths, functions, public, defined = [], [], 0, 0
    for path in sorted(SOURCE.rglob("*.py")):
        text = path.read_text()
        tree = ast.parse(text)
        lines = len(text.splitlines())
        names = len(list(public_names(path, tree)))
        room = rooms.setdefault(path.relative_to(SOURCE).parts[0], [0, 0, 0])
        for index, value in enumerate((1, lines, names)):
            room[index] += value
        lengths.append(lines)
        public += names
        defined += sum(isinstance(node, (*FUNCTION, ast.ClassDef)) for node in tree.body)
        found = (node for node in ast.walk(tree) if isinstance(node, FUNCTION))
        functions += [(node.end_lineno or node.lineno) - node.lineno + 1 for node in found]
    print("| room | files | lines | public names |\n| --- | --- | --- | --- |")
    for name, (files, lines, names) in rooms.items():
        print(f"| {name} | {files} | {lines:,} | {names} |")
    print(f"| all | {len(lengths)} | {sum(lengths):,} | {public} |")
    small = sum(lines < SMALL for lines in lengths)
    print(f"\n{small} files below {SMALL} lines, {sum(n > LARGE for n in lengths)} above {LARGE};")
    print(f"{defined} functions and classes at the top level of a module, {public} of them public;")
    print(f"functions have {sum(functions) / len(functions):.1f} lines on average.")


if __name__ == "__main__":
    main()
