"""Other trackers, each with the settings that its authors recommend; -1 where they give no track.

In an environment of their own: ``pip install trackers norfair stonesoup trackeval`` (trackeval
brings a second OpenCV, which must not stand beside opencv-python-headless).
"""

import importlib.util
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.perception._tracking import Tracker
from scene4d.tracking._association import GroundTracker

Update = Callable[[float, Detections, Located, np.ndarray | None], np.ndarray]
"""Track numbers of one frame's detections."""


@dataclass(frozen=True)
class Method:
    name: str
    start: Callable[[float, Camera], Update]
    """A new tracker for footage of so many frames per second."""
    needs: str | None = None

    @property
    def here(self) -> bool:
        return self.needs is None or importlib.util.find_spec(self.needs) is not None


def _ours(fps: float, camera: Camera) -> Update:
    return GroundTracker(camera=camera).update


def _image_space(fps: float, camera: Camera) -> Update:
    tracker = Tracker()
    return lambda t, found, located, colour: tracker.update(found.box_xyxy, t, colour)


def _roboflow(name: str) -> Callable[[float, Camera], Update]:
    def start(fps: float, camera: Camera) -> Update:
        import supervision as sv
        import trackers

        tracker = getattr(trackers, name)(frame_rate=fps)

        def update(t: float, found: Detections, located: Located, colour: object) -> np.ndarray:
            rows = sv.Detections(
                found.box_xyxy, confidence=found.score, data={"row": np.arange(len(found))}
            )
            out = tracker.update(rows)
            label = np.full(len(found), -1)
            if len(out):
                label[out.data["row"]] = out.tracker_id
            return label

        return update

    return start


def _norfair(fps: float, camera: Camera) -> Update:
    import norfair

    # The values of its documentation for boxes by overlap.
    tracker = norfair.Tracker(distance_function="iou", distance_threshold=0.7)

    def update(t: float, found: Detections, located: Located, colour: object) -> np.ndarray:
        rows = [
            norfair.Detection(box.reshape(2, 2), scores=np.repeat(score, 2), data=row)
            for row, (box, score) in enumerate(zip(found.box_xyxy, found.score, strict=True))
        ]
        label = np.full(len(found), -1)
        for track in tracker.update(detections=rows):
            last = track.last_detection
            if any(last is row for row in rows):
                label[last.data] = track.id
        return label

    return update


def _stone_soup(associator: str) -> Callable[[float, Camera], Update]:
    """Kalman filter on the same ground points, joint probabilistic or nearest association."""

    def start(fps: float, camera: Camera) -> Update:
        from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
        from stonesoup.dataassociator.probability import JPDA
        from stonesoup.deleter.time import UpdateTimeStepsDeleter
        from stonesoup.hypothesiser.distance import DistanceHypothesiser
        from stonesoup.hypothesiser.probability import PDAHypothesiser
        from stonesoup.initiator.simple import MultiMeasurementInitiator
        from stonesoup.measures import Mahalanobis
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import (
            CombinedLinearGaussianTransitionModel,
            ConstantVelocity,
        )
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
        from stonesoup.types.detection import Detection
        from stonesoup.types.state import GaussianState
        from stonesoup.updater.kalman import KalmanUpdater

        motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.5)] * 2)
        predictor, updater = KalmanPredictor(motion), KalmanUpdater(None)
        deleter = UpdateTimeStepsDeleter(round(fps))
        if associator == "JPDA":
            hypothesiser = PDAHypothesiser(predictor, updater, 1e-3, 0.9, 0.95)
            chosen, kind = JPDA(hypothesiser), MultiTargetMixtureTracker
        else:
            hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), 4)
            chosen, kind = GNNWith2DAssignment(hypothesiser), MultiTargetTracker
        prior = GaussianState([0, 0, 0, 0], np.diag([0, 1.4, 0, 1.4]))
        initiator = MultiMeasurementInitiator(
            prior,
            deleter,
            GNNWith2DAssignment(DistanceHypothesiser(predictor, updater, Mahalanobis(), 3)),
            updater,
            min_points=3,
        )
        waiting: list[tuple[datetime, set[Detection]]] = []

        def frames() -> Iterator[tuple[datetime, set[Detection]]]:
            while True:
                yield waiting.pop()

        tracker = kind(initiator, deleter, frames(), chosen, updater)
        iterator = iter(tracker)
        numbers: dict[str, int] = {}

        def update(t: float, found: Detections, located: Located, colour: object) -> np.ndarray:
            now = datetime(2000, 1, 1) + timedelta(seconds=t)
            rows = {
                Detection(
                    located.xy_m[k][:, None],
                    timestamp=now,
                    measurement_model=LinearGaussian(4, (0, 2), located.covariance_m2[k]),
                    metadata={"row": k},
                )
                for k in np.flatnonzero(located.known)
            }
            waiting.append((now, rows))
            _, tracks = next(iterator)
            label, best = np.full(len(found), -1), np.zeros(len(found))
            for track in tracks:
                for row, weight in _chosen_rows(track.states[-1]):
                    if weight > best[row]:
                        best[row] = weight
                        label[row] = numbers.setdefault(track.id, len(numbers))
            return label

        return update

    return start


def _chosen_rows(state: object) -> list[tuple[int, float]]:
    """The sighting that a track's update rests on most, if it had one."""
    hypothesis = getattr(state, "hypothesis", None)
    if hypothesis is None:
        return []
    several = hypothesis if hasattr(hypothesis, "single_hypotheses") else [hypothesis]
    found = [
        (h.measurement.metadata["row"], float(getattr(h, "probability", 1.0))) for h in several if h
    ]
    return [max(found, key=lambda pair: pair[1])] if found else []


METHODS = (
    Method("ours, on the ground", _ours),
    Method("ours, in the image (calibrate's)", _image_space),
    Method("trackers: ByteTrack", _roboflow("ByteTrackTracker"), "trackers"),
    Method("trackers: SORT", _roboflow("SORTTracker"), "trackers"),
    Method("norfair: IoU", _norfair, "norfair"),
    Method("Stone Soup: Kalman, JPDA", _stone_soup("JPDA"), "stonesoup"),
    Method("Stone Soup: Kalman, GNN", _stone_soup("GNN"), "stonesoup"),
)


def follow(
    method: Method,
    found: Detections,
    located: Located,
    colour: np.ndarray | None,
    frames: int,
    fps: float,
    camera: Camera,
) -> tuple[np.ndarray, float]:
    """Track numbers of all detections, and seconds per frame."""
    update = method.start(fps, camera)
    label = np.full(len(found), -1)
    order = np.argsort(found.frame, kind="stable")
    ends = np.searchsorted(found.frame[order], np.arange(frames + 1))
    spent = 0.0
    for frame in range(frames):
        rows = order[ends[frame] : ends[frame + 1]]
        part, there = found.select(rows), located.select(rows)
        seen = None if colour is None else colour[rows]
        begun = time.perf_counter()
        label[rows] = update(frame / fps, part, there, seen)
        spent += time.perf_counter() - begun
    return label, spent / frames
