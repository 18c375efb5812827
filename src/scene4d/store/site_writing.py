"""Writing a site: all of its files, or none."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from scene4d.core.calibration import Calibration
from scene4d.core.files import write_bytes, write_json
from scene4d.core.staging import ensure_folder, staged
from scene4d.core.tables import write_people
from scene4d.store.identities import Identities
from scene4d.store.runs import file_name
from scene4d.store.site_file import SITE_FILE, SiteFile


def write_site(
    out: Path,
    said: SiteFile,
    identities: Identities,
    *,
    refined: Mapping[str, Calibration],
    pictures: Mapping[str, bytes],
) -> None:
    """Write ``site.json``, the identities, refined calibrations by camera and pictures by file
    name; a site that was there is replaced, in the moment in which ``site.json`` is.

    Raises :class:`OutputError` naming the file.
    """
    folder = ensure_folder(out)
    version = _version(said.to_dict(folder), identities, refined)
    cameras = {f"cameras/{file_name(name, 'camera')}-{version}.json": name for name in refined}
    placed = {name: replace(said.cameras[name], camera=folder / file)
              for file, name in cameras.items()}  # fmt: skip
    said = replace(said, cameras=said.cameras | placed, identities=f"identities-{version}.parquet")
    before = [path.relative_to(folder).as_posix() for path in _earlier(folder)]
    names = [*dict.fromkeys([said.identities, *cameras, *pictures, *before])]
    with staged(folder, names, last=SITE_FILE) as staging:
        write_people(staging / said.identities, identities.columns())
        for file in (*cameras, *pictures):
            (staging / file).parent.mkdir(parents=True, exist_ok=True)
        for file, name in cameras.items():
            refined[name].save(staging / file)
        for file, png in pictures.items():
            write_bytes(staging / file, png)
        write_json(staging / SITE_FILE, said.to_dict(folder))


def _version(
    said: dict[str, Any], identities: Identities, refined: Mapping[str, Calibration]
) -> str:
    """Names what is written: another site has another one."""
    whole = hashlib.sha256()
    for values in identities.columns().values():
        whole.update(json.dumps(values.tolist()).encode())
    for content in (said, *(found.to_dict() for found in refined.values())):
        whole.update(json.dumps(content, sort_keys=True).encode())
    return whole.hexdigest()[:8]


def _earlier(folder: Path) -> list[Path]:
    """Files of the site that was here before, which the new one may not have."""
    if not (folder / SITE_FILE).exists():
        return []
    patterns = ("identities*.parquet", "cameras/*.json", "pairs/*.png")
    return [path for pattern in patterns for path in folder.glob(pattern)]
