"""``scene4d fleet``: a plan of many cameras and clips, run here or on Ray, into one store."""

from scene4d.fleet._plan import Plan, read_plan
from scene4d.fleet.running import FleetRun, run_fleet

__all__ = ["FleetRun", "Plan", "read_plan", "run_fleet"]
