"""Make the table of people that ``scene4d demo`` falls back on where the network is closed.

    python examples/make_demo_table.py [VIDEO]

Runs scene4d's own perception on the sample video (fetched if VIDEO is not given) and writes
``src/scene4d/formats/data/demo_people.parquet``.
"""

import sys
from pathlib import Path

from scene4d.core.fetching import cache_dir
from scene4d.core.tables import write_people
from scene4d.formats.demo import FILE_NAME, demo_columns
from scene4d.perception.people import detect_people
from scene4d.video.reader import open_source
from scene4d.video.sample import sample_video
from scene4d.video.sampling import sample_frames

TARGET = Path(__file__).parents[1] / "src" / "scene4d" / "formats" / "data" / FILE_NAME


def main() -> None:
    video = sys.argv[1] if len(sys.argv) > 1 else sample_video(cache_dir() / "samples")
    with open_source(video) as footage:
        people = detect_people(sample_frames(footage))
    TARGET.parent.mkdir(exist_ok=True)
    write_people(TARGET, demo_columns(people))
    print(f"{TARGET}: {len(people)} people, {TARGET.stat().st_size} bytes")


if __name__ == "__main__":
    main()
