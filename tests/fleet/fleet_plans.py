"""Plans of annotated clips, which need no network and no footage, and a stage that does little."""

from pathlib import Path

from walks import CAMERA, FPS, mot_text

CAMERAS = ("gate", "yard")


def boxes(folder: Path, clips: int = 2) -> Path:
    """A folder with clips of two cameras, and the camera's file."""
    CAMERA.save(folder / "camera.json")
    for camera in CAMERAS:
        (folder / camera).mkdir()
        for number in range(clips):
            text = mot_text(tracks=True).splitlines()
            kept = [line for line in text if int(line.partition(",")[0]) <= 30 - number]
            (folder / camera / f"{camera}-20261120T08{number:02d}00.txt").write_text(
                "\n".join(kept)
            )
    return folder


def plan(folder: Path, *more: str, camera: str = "camera.json") -> Path:
    """A plan that tracks them."""
    lines = ["cameras:"]
    for name in CAMERAS:
        lines += [f"  {name}:", f"    boxes: {name}/*.txt", f"    camera: {camera}"]
        lines += [f'    start: "{name}-%Y%m%dT%H%M%S"']
    lines += [f"track: {{fps: {FPS}, rate_hz: 5, format: mot}}", *more]
    path = folder / "plan.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path
