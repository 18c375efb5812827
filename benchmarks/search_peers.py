"""Who enters a vehicle, without scene4d: python benchmarks/search_peers.py HOW SCENE

What one would write instead, on the same Parquet files: a person is within 2.5 m of a vehicle in
one frame, and (all but "sql_near") the person's track ends within a second of it. Prints the pairs
(person, vehicle) as JSON. Nothing is imported but what each needs.
"""

import json
import sys
from pathlib import Path
from typing import Any

NEAR_M, END_S = 2.5, 1.0
VEHICLES = ("car", "truck", "bus", "motorcycle", "vehicle")
Pairs = list[tuple[int, int]]

_NEAR = f"""
select p.track as person, v.track as vehicle, max(p.time_s) as last_s
from rows as p join rows as v using (frame)
where p.class = 'person' and v.class in {VEHICLES}
  and (p.x_m - v.x_m) ** 2 + (p.y_m - v.y_m) ** 2 < {NEAR_M**2}
group by all
"""
_VANISHED = f"""
with ends as (select track as person, max(time_s) as end_s from rows group by track)
select person, vehicle from ({_NEAR}) join ends using (person) where end_s - last_s <= {END_S}
"""


def files(scene: Path) -> list[str]:
    return sorted(map(str, scene.glob("tracks/**/*.parquet")))


def _sql(scene: Path, query: str) -> Pairs:
    import duckdb

    connection = duckdb.connect()
    connection.execute(
        "create view rows as select track, frame, time_s, class, x_m, y_m "
        f"from read_parquet({files(scene)}, hive_partitioning = false)"
    )
    return [(person, vehicle) for person, vehicle, *_ in connection.execute(query).fetchall()]


def sql_near(scene: Path) -> Pairs:
    return _sql(scene, _NEAR)


def sql_vanished(scene: Path) -> Pairs:
    return _sql(scene, _VANISHED)


def _rows(scene: Path) -> Any:
    import pandas

    columns = ["track", "frame", "time_s", "class", "x_m", "y_m"]
    return pandas.concat([pandas.read_parquet(path, columns=columns) for path in files(scene)])


def merged(scene: Path) -> Pairs:
    """pandas, as the SQL."""
    rows = _rows(scene)
    end_s = rows.groupby("track").time_s.max()
    people, vehicles = rows[rows["class"] == "person"], rows[rows["class"].isin(VEHICLES)]
    pairs = people.merge(vehicles, on="frame", suffixes=("", "_v"))
    apart2 = (pairs.x_m - pairs.x_m_v) ** 2 + (pairs.y_m - pairs.y_m_v) ** 2
    last_s = pairs[apart2 < NEAR_M**2].groupby(["track", "track_v"]).time_s.max()
    return [pair for pair, last in last_s.items() if end_s[pair[0]] - last <= END_S]


PEERS = {
    "sql_near": sql_near,
    "sql_vanished": sql_vanished,
    "merged": merged,
}


if __name__ == "__main__":
    print(json.dumps(PEERS[sys.argv[1]](Path(sys.argv[2]))))
