"""People in images: detections, and the upright segments made from them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.body import FOOT_HEIGHT_M
from scene4d.core.columns import Columns
from scene4d.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Detections(Columns):
    """Boxes (and keypoints, where known) of one clip, one row per object and frame.

    Pixels of the footage as decoded (distorted). ``frame`` counts from 0, ``time_s`` is NaN where
    unknown, ``track`` is -1 where unknown, ``keypoint_uv`` is (n, k, 2) with k = 0 where there
    are none, ``keypoint_score`` (n, k) in [0, 1].
    """

    image_size: tuple[int, int]
    frame: Int[np.ndarray, "n"]
    time_s: Float[np.ndarray, "n"]
    box_xyxy: Float[np.ndarray, "n 4"]
    score: Float[np.ndarray, "n"]
    track: Int[np.ndarray, "n"]
    class_name: np.ndarray
    keypoint_uv: Float[np.ndarray, "n k 2"]
    keypoint_score: Float[np.ndarray, "n k"]
    keypoint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.check_rows("detections")
        for name in ("keypoint_uv", "keypoint_score"):
            found = getattr(self, name).shape[1]
            if found != len(self.keypoint_names):
                raise InputError(
                    f"detections: {name} holds {found} keypoints, "
                    f"keypoint_names {len(self.keypoint_names)}"
                )

    @classmethod
    def from_boxes(
        cls,
        image_size: tuple[int, int],
        frame: np.ndarray,
        box_xyxy: np.ndarray,
        *,
        time_s: np.ndarray | None = None,
        score: np.ndarray | None = None,
        track: np.ndarray | None = None,
        class_name: np.ndarray | None = None,
        keypoint_uv: np.ndarray | None = None,
        keypoint_score: np.ndarray | None = None,
        keypoint_names: tuple[str, ...] = (),
    ) -> "Detections":
        """Detections with the usual defaults: unknown times and tracks, persons, score 1."""
        n = len(frame)
        return cls(
            image_size=image_size,
            frame=np.asarray(frame, np.int64),
            time_s=np.full(n, np.nan) if time_s is None else np.asarray(time_s, float),
            box_xyxy=np.asarray(box_xyxy, float).reshape(-1, 4),
            score=np.ones(n) if score is None else np.asarray(score, float),
            track=np.full(n, -1) if track is None else np.asarray(track, np.int64),
            class_name=np.full(n, "person") if class_name is None else np.asarray(class_name),
            keypoint_uv=np.full((n, len(keypoint_names), 2), np.nan)
            if keypoint_uv is None
            else np.asarray(keypoint_uv, float),
            keypoint_score=np.zeros((n, len(keypoint_names)))
            if keypoint_score is None
            else np.asarray(keypoint_score, float),
            keypoint_names=keypoint_names,
        )

    @property
    def box_foot_uv(self) -> Float[np.ndarray, "n 2"]:
        """Bottom centres of the boxes, which approximate the ground contact."""
        x1, _, x2, y2 = self.box_xyxy.T
        return np.column_stack([(x1 + x2) / 2, y2])

    def without_keypoints(self) -> "Detections":
        """The boxes alone."""
        n = len(self)
        return replace(
            self,
            keypoint_uv=np.empty((n, 0, 2)),
            keypoint_score=np.empty((n, 0)),
            keypoint_names=(),
        )

    @classmethod
    def concatenate(cls, parts: Sequence["Detections"]) -> "Detections":
        """One table of several of the same image size and skeleton; raises on an empty list."""
        if not parts:
            raise InputError("detections: nothing to concatenate")
        first = parts[0]
        if any(p.image_size != first.image_size for p in parts):
            raise InputError("detections: the parts differ in image_size")
        if any(p.keypoint_names != first.keypoint_names for p in parts):
            raise InputError("detections: the parts differ in keypoint_names")
        return cls.joined(parts)


@dataclass(frozen=True, eq=False)
class Segments(Columns):
    """Upright people as foot and head points, one row per sighting; the calibrator's input.

    Pixels of the footage (undistorted for ``solve_camera``). ``foot_uv`` is the
    midpoint of the feet, or the bottom centre of the box where ``from_box``; ``head_uv`` the top
    of the head, or the top centre of the box. ``track`` -1 where unknown, ``time_s`` may be NaN.
    """

    foot_uv: Float[np.ndarray, "n 2"]
    head_uv: Float[np.ndarray, "n 2"]
    frame: Int[np.ndarray, "n"]
    time_s: Float[np.ndarray, "n"]
    track: Int[np.ndarray, "n"]
    score: Float[np.ndarray, "n"]
    box_xyxy: Float[np.ndarray, "n 4"]
    from_box: Bool[np.ndarray, "n"]

    def __post_init__(self) -> None:
        self.check_rows("segments")

    @property
    def foot_height_m(self) -> Float[np.ndarray, "n"]:
        """Height above the ground (m) of the points ``foot_uv``: foot keypoints, or a box edge."""
        return np.where(self.from_box, 0.0, FOOT_HEIGHT_M)

    @classmethod
    def from_points(
        cls,
        foot_uv: np.ndarray,
        head_uv: np.ndarray,
        *,
        track: np.ndarray | None = None,
        from_box: bool = False,
    ) -> "Segments":
        """Segments of bare points, with everything else unknown."""
        n = len(foot_uv)
        foot, head = np.asarray(foot_uv, float), np.asarray(head_uv, float)
        return cls(
            foot_uv=foot,
            head_uv=head,
            frame=np.zeros(n, np.int64),
            time_s=np.full(n, np.nan),
            track=np.full(n, -1) if track is None else np.asarray(track, np.int64),
            score=np.ones(n),
            box_xyxy=np.full((n, 4), np.nan),
            from_box=np.full(n, from_box),
        )
