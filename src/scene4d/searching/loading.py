"""Runs of a scene as stages, with no column that a search does not look at.

:meth:`Scene.tracks` brings everything; of a day that is mostly keypoints and covariances that no
predicate asks for, and takes several times as long as the search itself.
"""

from collections.abc import Collection

import numpy as np
from arro3.core import Table
from jaxtyping import Int

from scene4d.core.calibration import Calibration
from scene4d.core.tracks import CLASSES, Tracks
from scene4d.searching.activities.definition import Activity
from scene4d.searching.places import Places
from scene4d.searching.stages import STEP_S, Staged
from scene4d.searching.stages.staging import kept_moments, stage_of_thinned, thinned
from scene4d.store.query import Scene
from scene4d.store.runs import Run

_POSED = frozenset({"arm_moving_up", "arm_moving_down"})
"""Predicates that look at keypoints."""
_WHOLE = ("track", "frame", "time_s", "observed")
_FLOATS = (
    "x_m", "y_m", "var_xx", "var_xy", "var_yy", "vx_mps", "vy_mps", "var_vxx", "var_vxy",
    "var_vyy", "heading_rad", "heading_sigma_rad", "x1", "y1", "x2", "y2",
)  # fmt: skip


def staged_run(
    scene: Scene, run: Run, calibration: Calibration, places: Places, *, with_keypoints: bool
) -> Staged:
    """One run of a scene as a stage; raises as :meth:`Scene.sql` and :func:`stage_of`.

    Tracks of annotations, where one object may have several, are united.
    """
    alone = scene.only(run.run)
    tracks, step_s = thinned(alone.tracks(), STEP_S) if with_keypoints else lean_tracks(alone)
    stage = stage_of_thinned(
        tracks,
        step_s,
        calibration,
        zones=places.of(run.camera, "zone"),
        lines=places.of(run.camera, "line"),
    )
    if "annotations" in run.provenance:
        from scene4d.searching.activities.identity import unite_tracks  # SciPy's graphs load slowly

        stage = unite_tracks(stage)
    return Staged(stage, run.camera, run)


def asks_for_keypoints(activity: Activity) -> bool:
    """Whether any predicate of an activity looks at the body."""
    return any(term.predicate in _POSED for phase in activity.phases for term in phase.terms)


def playable(activity: Activity, classes: Collection[str]) -> bool:
    """Whether there is somebody for every role."""
    return all(set(role.classes) & set(classes) for role in activity.roles)


def lean_tracks(scene: Scene, step_s: float = STEP_S) -> tuple[Tracks, float]:
    """:func:`thinned` rows of a scene, ordered by (track, time), and the time between them; without
    keypoints, shared covariances (the stage works these out of the calibration) and scores.
    """
    kinds = " ".join(f"WHEN '{name}' THEN {code}" for code, name in enumerate(CLASSES))
    floats = ", ".join(f"coalesce({name}, 'nan'::DOUBLE) AS {name}" for name in _FLOATS)
    kind = f"(CASE class {kinds} END)::TINYINT AS kind"
    table = scene.sql(f"SELECT {', '.join(_WHOLE)}, {floats}, {kind} FROM scene")
    track, time_s = _numpy(table, "track"), _numpy(table, "time_s")
    kept, step_s = kept_moments(time_s, step_s)
    # Faster than to let DuckDB order whole rows.
    order = np.lexsort((time_s, track))
    if kept is not None:
        order = order[kept[order]]
    n = len(order)

    def column(name: str) -> np.ndarray:
        return _numpy(table, name)[order]

    def columns(*names: str) -> np.ndarray:
        found = np.empty((n, len(names)))
        for at, name in enumerate(names):
            if name in names[:at]:
                found[:, at] = found[:, names.index(name)]
            else:
                found[:, at] = column(name)
        return found

    tracks = Tracks(
        track=track[order],
        class_name=_names(column("kind")),
        time_s=time_s[order],
        frame=column("frame"),
        xy_m=columns("x_m", "y_m"),
        covariance_m2=columns("var_xx", "var_xy", "var_xy", "var_yy").reshape(-1, 2, 2),
        shared_covariance_m2=np.broadcast_to(np.full((2, 2), np.nan), (n, 2, 2)),
        velocity_mps=columns("vx_mps", "vy_mps"),
        velocity_covariance=columns("var_vxx", "var_vxy", "var_vxy", "var_vyy").reshape(-1, 2, 2),
        heading_rad=column("heading_rad"),
        heading_sigma_rad=column("heading_sigma_rad"),
        box_xyxy=columns("x1", "y1", "x2", "y2"),
        keypoint_uv=np.zeros((n, 0, 2)),
        keypoint_score=np.zeros((n, 0)),
        score=np.broadcast_to(np.nan, n),
        observed=column("observed"),
    )
    return tracks, step_s


def _names(kind: Int[np.ndarray, "n"]) -> np.ndarray:
    """Classes by their place in :data:`CLASSES`, in no more room than those that there are need."""
    there = np.flatnonzero(np.bincount(kind, minlength=len(CLASSES)))
    place = np.zeros(len(CLASSES), np.intp)
    place[there] = np.arange(len(there))
    return np.array([CLASSES[one] for one in there.tolist()])[place[kind]]


def _numpy(table: Table, name: str) -> np.ndarray:
    return np.asarray(table[name].to_numpy())
