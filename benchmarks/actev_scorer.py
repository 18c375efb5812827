"""What searches find on MEVA, scored by NIST's own ActEV_Scorer, where that is installed.

    python -m benchmarks.actev_scorer [--scorer ActEV_Scorer.py] [--data DIR] [--camera NAME ...]

DIR holds meva/. The annotated clips of the cameras become a scene, `scene4d search "all activities"
--actev` writes one file, and the labels become the scorer's reference, activity index and file
index. The scorer is looked for as ActEV_Scorer.py on the PATH; it needs packages of its own.
"""

import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks import options_of
from scene4d.core.files import read_json, write_json
from scene4d.evaluation._options import REPORTED
from scene4d.formats.activities import ActevInstance, actev_json, read_activities
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.tracking import TrackOptions, track

FPS = 30.0
MINUTES = 5
PROTOCOL = "ActEV_SDL_V2"


def inputs(labels: Sequence[Path], system: Path, out: Path) -> list[str]:
    """Write what the scorer compares ``system`` with into ``out``; its arguments.

    Clips are named as the search names them, by the file of their labels without its ending. A clip
    lasts five minutes.
    """
    names = {path: path.name.removesuffix(".activities.yml") for path in labels}
    known = {one.labels[0] for one in load_catalogue().values() if one.labels}
    instances = [
        ActevInstance(one.name, name, one.begin_frame, one.end_frame, 1.0)
        for path, name in names.items()
        for one in read_activities(path)
        if one.name in known
    ]
    selected = {"framerate": FPS, "selected": {"0": 1, str(int(60 * MINUTES * FPS)): 0}}
    files = {
        "reference": actev_json(instances, list(names.values())),
        "activity-index": {name: {} for name in sorted({one.activity for one in instances})},
        "file-index": dict.fromkeys(names.values(), selected),
    }
    for name, values in files.items():
        write_json(out / f"{name}.json", values)
    arguments = [PROTOCOL, "-s", system, "-r", out / "reference.json", "-o", out / "scored", "-d"]
    arguments += ["-a", out / "activity-index.json", "-f", out / "file-index.json"]
    return [str(one) for one in arguments]


def searched(annotations: Path, cameras: Path, names: Sequence[str], out: Path) -> list[Path]:
    """Write ``system.json`` of the cameras' annotated clips into ``out``; their files of labels."""
    geometry = sorted(
        path for path in annotations.rglob("*.geom.yml") if path.name.split(".")[-3] in names
    )
    for path in geometry:
        camera = path.name.split(".")[-3]
        options = TrackOptions(annotations=path, name=camera, fps=FPS, drop_invalid=True)
        track(None, cameras / f"{camera}.krtd", out / "scene", options)
    search = ["search", out / "scene", "all activities", "--min-score", "0"]
    search += ["--actev", out / "system.json", "--json"]
    command = [sys.executable, "-m", "scene4d", *map(str, search)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    stems = [str(path).removesuffix(".geom.yml") for path in geometry]
    return [Path(f"{stem}.activities.yml") for stem in stems]


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--scorer", type=Path, default=shutil.which("ActEV_Scorer.py"))
    parser.add_argument("--camera", nargs="*", default=REPORTED)
    arguments = parser.parse_args()
    if arguments.scorer is None or not arguments.scorer.is_file():
        print("NIST's ActEV_Scorer is not here; give its ActEV_Scorer.py as --scorer.")
        return
    meva = arguments.data / "meva"
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch)
        with tarfile.open(meva / "annotations.tar.xz") as archive:
            archive.extractall(out, filter="data")
        labels = searched(out, meva / "cameras", arguments.camera, out)
        print(f"{len(labels)} clips, {len(read_json(out / 'system.json')['activities'])} events")
        command = [sys.executable, str(arguments.scorer)]
        subprocess.run([*command, *inputs(labels, out / "system.json", out)], check=True)
        print((out / "scored" / "scores_by_activity.csv").read_text())


if __name__ == "__main__":
    main()
