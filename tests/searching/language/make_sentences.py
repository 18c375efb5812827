"""Writes sentences.golden, what each search of sentences.txt is understood as:

python tests/searching/language/make_sentences.py
"""

from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.language import explain, parse_query

HERE = Path(__file__).parent
GOLDEN = HERE / "sentences.golden"
ZONES = ("entrance", "door", "car park")
LINES = ("gate",)


def decomposition(text, catalogue):
    """The lines of one search."""
    try:
        query = parse_query(text, catalogue, ZONES, LINES)
    except InputError as error:
        return [f"refused: {error}"]
    return [query.activity.name, *explain(query.activity, query.window, query.notes)]


def table():
    """The whole golden file."""
    catalogue = load_catalogue()
    out = []
    for line in (HERE / "sentences.txt").read_text("utf-8").splitlines():
        if line.startswith("#"):
            out.append(line)
        elif line:
            out += ["", f"> {line}", *(f"  {said}" for said in decomposition(line, catalogue))]
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    GOLDEN.write_text(table(), "utf-8")
