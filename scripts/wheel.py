"""Does what is shipped install and run? make wheel [PYTHON=python3.12]

The source distribution is built from the checkout, the wheel from it; both must hold what git
holds. An empty environment gets the wheel and nothing else, and runs the README's commands, in
order, on the sample video; the extras follow for what needs them. It takes a Python with venv,
a package index and, for the sample video, apt or the web.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tarfile
import tempfile
import time
import urllib.request
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NOT_SHIPPED = (".ci/", ".github/", ".gitignore", ".pre-commit-config.yaml")
"""For those who change the code, who have git."""

NOT_RUN = {
    "scene4d models fetch": "the demo has fetched them",
    "scene4d calibrate --annotations": "needs boxes of your own",
    "scene4d align": "needs two cameras of one place",
    "scene4d search site": "needs a site",
    "scene4d serve": "runs until Ctrl-C: asked for its page below",
}
STANDS_FOR = {"rtsp://gate/live": "gate.avi"}
PREPARE = """
import json, shutil, scene4d
found = scene4d.Calibration.load("scene4d-demo/camera.json")
scene4d.write_camera(found.camera, "lens.yaml", "opencv-yaml")
shutil.copy("scene4d-demo/background.jpg", "frame.jpg")
shutil.copy("scene4d-demo/pets.avi", "footage.mp4")
shutil.copy("scene4d-demo/pets.avi", "gate.avi")
shutil.copy("scene4d-demo/camera.json", "camera.json")
foot, head = (found.camera.project([[2.0, 15.0, z]])[0][0].tolist() for z in (0.0, 2.1))
upright = {"foot_uv": foot, "head_uv": head, "height_m": 2.1}
json.dump({"uprights": [upright]}, open("measured.json", "w"))
"""


def run(words: list, **options) -> None:
    begun_s = time.monotonic()
    print("+", shlex.join(map(str, words))[:150], flush=True)
    done = subprocess.run([*map(str, words)], check=False, **options)
    if done.returncode:
        raise SystemExit(f"wheel: ended with {done.returncode}")
    print(f"  {time.monotonic() - begun_s:.0f} s", flush=True)


def pinned() -> dict[str, str]:
    """The exact versions, in the isolated build too; pip splits these paths at spaces."""
    return os.environ | {
        "PIP_CONSTRAINT": "constraints.txt",
        "PIP_BUILD_CONSTRAINT": "constraints.txt",
    }


def environment(python: str, folder: Path) -> Path:
    run([python, "-m", "venv", folder])
    pip = [folder / "bin" / "python", "-m", "pip", "--quiet"]
    run([*pip, "install", "pip"], cwd=ROOT, env=pinned())
    return folder / "bin" / "python"


def built(python: Path, out: Path) -> Path:
    """The wheel, built from the source distribution."""
    pip = [python, "-m", "pip", "--quiet"]
    run([*pip, "install", "hatchling"], cwd=ROOT, env=pinned())
    run([python, "-m", "hatchling", "build", "-t", "sdist", "-d", out], cwd=ROOT)
    (source,) = out.glob("*.tar.gz")
    whole(source)
    run([*pip, "wheel", "--no-deps", "--wheel-dir", out, source], cwd=ROOT, env=pinned())
    (wheel,) = out.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        held = {f"src/{name}" for name in file.namelist() if ".dist-info/" not in name}
    same("wheel", held, {name for name in tracked() if name.startswith("src/")})
    for path in (source, wheel):
        print(f"  {path.name}: {path.stat().st_size / 1e6:.1f} MB")
    return wheel


def whole(source: Path) -> None:
    with tarfile.open(source) as file:
        held = {member.name.partition("/")[2] for member in file if member.isfile()}
    same(
        "sdist",
        held - {"PKG-INFO", ".gitignore"},
        {n for n in tracked() if not n.startswith(NOT_SHIPPED)},
    )


def tracked() -> set[str]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    return {name for name in listed.stdout.decode().split("\0") if (ROOT / name).is_file()}


def same(what: str, held: set[str], wanted: set[str]) -> None:
    if held != wanted:
        missing, more = sorted(wanted - held)[:9], sorted(held - wanted)[:9]
        raise SystemExit(f"wheel: the {what} lacks {missing} and has {more} beside what git holds")


def commands() -> list[str]:
    """The README's commands, without their remarks."""
    blocks = re.findall(r"```\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    return [" ".join(shlex.split(line, comments=True, posix=False))
            for line in lines if line.startswith("scene4d ")]  # fmt: skip


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)


def run_readme(python: Path, place: Path) -> None:
    """All that needs no extra."""
    program = python.with_name("scene4d")
    run([program, "demo"], cwd=place)
    run([python, "-c", PREPARE], cwd=place)
    for line in commands():
        reason = next((why for begin, why in NOT_RUN.items() if line.startswith(begin)), None)
        if reason is not None:
            print(f"- {line}: not run, {reason}")
            continue
        words = [STANDS_FOR.get(word, word) for word in shlex.split(line)]
        run([program, *words[1:]], cwd=place)
    for block in blocks("python"):
        run([python, "-c", block], cwd=place)


def run_extras(python: Path, wheel: Path, place: Path) -> None:
    run([python, "-m", "pip", "--quiet", "install", f"{wheel}[app,pandas]"], cwd=ROOT, env=pinned())
    program = blocks("py")[0].replace('"scene"', '"scene-py"').replace("camera.json", "found.json")
    run([python, "-c", program], cwd=place)
    words = [python.with_name("scene4d"), "serve", "scene4d-demo/scene", "--port", "0"]
    with subprocess.Popen(words, cwd=place, stderr=subprocess.PIPE, text=True) as server:
        try:
            told = []
            while "serving at" not in "".join(told):
                told.append(server.stderr.readline())
                if not told[-1]:
                    raise SystemExit(f"wheel: serve ended: {''.join(told)}")
            address = re.search(r"http://\S+", told[-1])[0]
            with urllib.request.urlopen(address, timeout=60) as page:
                assert b"<html" in page.read(), address
        finally:
            server.terminate()
    print("  the page was served")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default=sys.executable)
    with tempfile.TemporaryDirectory(prefix="scene4d-wheel-") as name:
        place, out = Path(name) / "place", Path(name) / "out"
        place.mkdir()
        given = parser.parse_args().python
        wheel = built(environment(given, Path(name) / "tools"), out)
        python = environment(given, Path(name) / "empty")
        run([python, "-m", "pip", "--quiet", "install", wheel], cwd=ROOT, env=pinned())
        run([python, "-m", "pip", "check"])
        run_readme(python, place)
        run_extras(python, wheel, place)
    print("wheel: installed and ran")


if __name__ == "__main__":
    main()
