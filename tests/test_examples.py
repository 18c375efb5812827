"""The notebooks of ``examples/`` run as they stand, and show what they say that they show."""

import ast
import json
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"


def shown(path: Path) -> list[str]:
    """Run the cells one after the other; what each ends with, as a notebook displays it."""
    scope: dict[str, object] = {}
    found = []
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] != "code":
            continue
        body = ast.parse("".join(cell["source"]), f"{path.name}, cell {number}").body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), f"{path.name}, cell {number}", "exec"), scope)
        if last is None:
            continue
        value = eval(
            compile(ast.Expression(last.value), f"{path.name}, cell {number}", "eval"), scope
        )
        if value is not None:
            html = getattr(value, "_repr_html_", None)
            found.append(repr(value) if html is None else html())
    return found


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_hold_no_outputs(path):
    said = json.loads(path.read_text(encoding="utf-8"))
    assert said["nbformat"] == 4
    code = [cell for cell in said["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len({cell["id"] for cell in said["cells"]}) == len(said["cells"])


def test_points_become_a_camera(capsys):
    camera, found = shown(FOLDER / "points_to_camera.ipynb")
    assert "<svg" in camera and "<svg" in found
    focal, sigma = re.search(r"<th>Focal length</th><td>(\d+) ± (\d+) px", found).groups()
    assert abs(float(focal) - 900) < 3 * float(sigma) < 90
    assert "± " in capsys.readouterr().out


def test_boxes_become_a_scene_that_is_searched(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene, rows, found, table, page = shown(FOLDER / "search_a_scene.ipynb")
    assert scene.count("<polyline") == 3 and "square" in scene
    assert "x_m" in rows
    assert "two people meet</b>: 1 event" in found and "<svg" in found
    assert table.count("<tr") == 2
    assert "page.html" in page and (tmp_path / "page.html").stat().st_size > 100_000
