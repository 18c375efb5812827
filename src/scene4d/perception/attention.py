"""Looks only where something can have changed: what stands still was seen already, and what moves
is followed in the picture between looks.

A region (the whole picture, or a tile) is looked at now and then; what it shows is carried along by
the picture's motion meanwhile. Closer looks are at what moved, got lost, or is new: parts of the
picture side by side in one small input of the network, where it can take one. Everything follows
from the pictures since the last :meth:`Attention.begin`, so a run that resumes there sees the same
as one that never stopped.
"""

import numpy as np
import supervision as sv
from jaxtyping import Float

from scene4d.perception._changes import GreyCopy
from scene4d.perception._gaze import Gaze
from scene4d.perception._motion import Motion
from scene4d.perception._postures import Postures
from scene4d.perception._scene import Scene
from scene4d.perception._standing import Vehicles
from scene4d.perception.colours import ColourReader
from scene4d.perception.detectors._base import Detector

_PEOPLE_S = 1.0
"""Seconds after which a region is looked at again for people even if nothing changed; chosen by
hand: nothing that comes goes unseen by the cells."""
_WIDTH, _HEIGHT = 0.15, 0.5
"""Smallest change that can be a person who was not known, in heights of a person there: half of one
who is hidden by half. Chosen by hand on PETS 2009."""


class Attention:
    """Where to look in successive frames of a still camera; one object per footage.

    ``vehicles`` None: the detector of people finds vehicles too.
    """

    def __init__(self, people: Detector, vehicles: Detector | None) -> None:
        self._people_detector, self._vehicle_detector = people, vehicles
        self.begin()

    def begin(self) -> None:
        """Forget what was seen."""
        self.postures = Postures()
        self.colours: dict[int, np.ndarray] = {}
        """Of the people in the last frame, by their numbers."""
        self.reader = ColourReader()
        self._motion: Motion | None = None
        self._people = Gaze(self._people_detector, _PEOPLE_S)
        also = self._vehicle_detector
        self._vehicles = None if also is None else Vehicles(also)

    def people(self, image: np.ndarray, time_s: float) -> tuple[sv.Detections, Scene]:
        """What the detector of people finds, and what :meth:`vehicles` needs, perhaps while the
        next image is looked at.
        """
        self._motion = Motion.between(self._motion, image)
        scene, gaze = Scene(image, time_s, GreyCopy(image), self._motion), self._people
        nobody = np.zeros(scene.copy.grey.shape, bool)
        gaze.look(scene, nobody, gaze.large(scene, _WIDTH, _HEIGHT))
        return gaze.found, scene

    def vehicles(self, scene: Scene, person_box_xyxy: Float[np.ndarray, "n 4"]) -> sv.Detections:
        """The vehicles in a scene that :meth:`people` gave, one row each."""
        assert self._vehicles is not None
        return self._vehicles.look(scene, person_box_xyxy)
