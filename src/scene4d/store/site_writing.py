"""Writing a site: all of its files, or none."""

from collections.abc import Mapping
from pathlib import Path

from scene4d.core.calibration import Calibration
from scene4d.core.files import write_bytes, write_json
from scene4d.core.staging import ensure_folder, staged
from scene4d.core.tables import write_people
from scene4d.store.identities import Identities
from scene4d.store.runs import file_name
from scene4d.store.site_file import IDENTITIES_FILE, SITE_FILE, SiteFile


def write_site(
    out: Path,
    said: SiteFile,
    identities: Identities,
    *,
    refined: Mapping[str, Calibration],
    pictures: Mapping[str, bytes],
) -> None:
    """Write ``site.json``, the identities, refined calibrations by camera and pictures by file
    name; a site that was there is replaced.

    A camera of ``refined`` is named in ``said`` with the path of :func:`refined_path`. Raises
    :class:`OutputError` naming the file.
    """
    folder = ensure_folder(out)
    cameras = {str(refined_path(Path(), name)): found for name, found in refined.items()}
    before = [path.relative_to(folder).as_posix() for path in _earlier(folder)]
    names = [*dict.fromkeys([IDENTITIES_FILE, *cameras, *pictures, *before])]
    with staged(folder, names, last=SITE_FILE) as staging:
        write_people(staging / IDENTITIES_FILE, identities.columns())
        for name in (*cameras, *pictures):
            (staging / name).parent.mkdir(parents=True, exist_ok=True)
        for name, calibration in cameras.items():
            calibration.save(staging / name)
        for name, png in pictures.items():
            write_bytes(staging / name, png)
        write_json(staging / SITE_FILE, said.to_dict(folder))


def refined_path(folder: Path, camera: str) -> Path:
    """Where a site keeps the refined calibration of a camera."""
    return folder / "cameras" / f"{file_name(camera, 'camera')}.json"


def _earlier(folder: Path) -> list[Path]:
    """Files of the site that was here before, which the new one may not have."""
    if not (folder / SITE_FILE).exists():
        return []
    return [*folder.glob("cameras/*.json"), *folder.glob("pairs/*.png")]
