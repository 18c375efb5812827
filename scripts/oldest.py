"""Do the lower bounds of pyproject.toml hold? python scripts/oldest.py [--python python3.11]

Each dependency, with those of the extras, is installed at its lower bound, and what they need at
whatever fits. Then every module is imported, the demo runs (camera, tracks, search, pages), and
its scene is exported, searched, viewed and read as a table.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("app", "geo", "mqtt", "pandas")
"""``fast`` and ``torch`` take gigabytes, and what they do is optional speed."""
MODULES = """
import importlib, pkgutil, scene4d
for one in pkgutil.walk_packages(scene4d.__path__, "scene4d."):
    if not one.name.endswith("__main__"):
        importlib.import_module(one.name)
"""
TABLE = """
import scene4d
scene = scene4d.Scene.open("scene4d-demo/scene")
frame = scene.to_pandas(classes=["person"])
assert len(frame) > 100 and str(frame["time"].dtype).endswith("UTC]"), frame.dtypes
"""
COMMANDS = (
    "demo",
    "export scene4d-demo/scene --to csv --out tracks.csv",
    "export scene4d-demo/camera.json --to opencv-yaml --out lens.yaml",
    "calibrate scene4d-demo/pets.avi --lens lens.yaml --out again",
    'search scene4d-demo/scene "a person walks" --out walkers',
    "view scene4d-demo/scene --out page.html",
)


def oldest() -> list[str]:
    """``name==bound`` for everything that has one."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = list(project["dependencies"])
    for extra in EXTRAS:
        lines += project["optional-dependencies"][extra]
    matches = [re.match(r"([\w.-]+)>=([\d.]+)", line) for line in lines]
    bare = [line for line, match in zip(lines, matches, strict=True) if match is None]
    if bare:
        raise SystemExit(f"oldest: no lower bound: {', '.join(bare)}")
    return [f"{match[1]}=={match[2]}" for match in matches if match]


def run(words: list, **options) -> None:
    print("+", *words[1:], flush=True)
    if subprocess.run([*map(str, words)], check=False, **options).returncode:
        raise SystemExit("oldest: failed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default=sys.executable)
    with tempfile.TemporaryDirectory(prefix="scene4d-oldest-") as name:
        place = Path(name)
        (place / "oldest.txt").write_text("\n".join(oldest()) + "\n")
        run([parser.parse_args().python, "-m", "venv", place / "env"])
        python = place / "env" / "bin" / "python"
        pip = [python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
        run([*pip, "--constraint", place / "oldest.txt", f"{ROOT}[{','.join(EXTRAS)}]"])
        run([python, "-m", "pip", "check"])
        run([python, "-c", MODULES], cwd=place)
        for line in COMMANDS:
            words = re.findall(r'"[^"]*"|\S+', line)
            program = python.with_name("scene4d")
            run([program, *(word.strip('"') for word in words)], cwd=place)
        run([python, "-c", TABLE], cwd=place)
    print("oldest: all bounds hold")


if __name__ == "__main__":
    main()
