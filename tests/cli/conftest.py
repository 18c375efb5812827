"""What the command-line tests stand on: a camera with people in front of it, and the program."""

import os
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from cli_scenes import PROGRAM, SIZE, mot_text, people
from scene4d.cli.app import app
from scene4d.core.camera import Camera
from scene4d.core.errors import UnavailableError
from scene4d.perception.weights import weight_path


@pytest.fixture(scope="session")
def camera() -> Camera:
    return Camera.from_pose(
        image_size=SIZE, focal_px=1100.0, tilt_rad=0.3, roll_rad=0.02, height_m=6.0
    )


@pytest.fixture
def scene(tmp_path: Path, camera: Camera) -> dict[str, Path]:
    """Files of a scene: ``boxes`` in MOTChallenge's format, and the ``lens``."""
    boxes, lens = tmp_path / "boxes.txt", tmp_path / "lens.json"
    boxes.write_text(mot_text(people(camera)))
    camera.save(lens)
    return {"boxes": boxes, "lens": lens}


@pytest.fixture
def known(scene: dict[str, Path]) -> list[str]:
    """Arguments that calibrate the scene from its boxes alone, without footage."""
    size = f"{SIZE[0]}x{SIZE[1]}"
    return [
        "calibrate", "--annotations", str(scene["boxes"]), "--image-size", size,
        "--lens", str(scene["lens"]),
    ]  # fmt: skip


@pytest.fixture
def run() -> Callable[..., Result]:
    """The program within this process: exit code, stdout and stderr."""

    def invoke(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(a) for a in arguments])

    return invoke


@pytest.fixture(scope="session")
def spawn() -> Callable[..., subprocess.CompletedProcess[str]]:
    """The program as a process of its own."""

    def start(arguments: Sequence[object], **options: object) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "COLUMNS": "100", **options.pop("env", {})}
        given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 120, **options}
        command = [*PROGRAM, *map(str, arguments)]
        return subprocess.run(command, text=True, env=environment, check=False, **given)

    return start


@pytest.fixture(scope="session")
def networks() -> None:
    """The networks; skipped with one sentence where they cannot be had (a failure in CI)."""
    try:
        weight_path("yolox-tiny")
        weight_path("rtmpose-s")
    except UnavailableError as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(f"the networks cannot be had here: {error}")


@pytest.fixture(scope="session")
def pets(shared_data: Path) -> Path:
    return shared_data / "pets2009" / "vtest.avi"


@pytest.fixture(scope="session")
def pets_images(pets: Path) -> list[np.ndarray]:
    """Eight pictures of PETS S2L1, spread over it."""
    video = cv2.VideoCapture(str(pets))
    images = []
    for index in range(0, 640):
        video.grab()
        if index % 80 == 0:
            images.append(video.retrieve()[1])
    return images


@pytest.fixture
def plain_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without figures, which take seconds, where they are not the matter."""
    monkeypatch.setattr("scene4d.calibration.report._page._draw", lambda *_: {})
