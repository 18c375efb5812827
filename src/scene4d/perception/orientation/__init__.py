"""Camera orientation from single pictures: focal length, tilt and roll, each as a distribution."""

from scene4d.perception.orientation.evidence import PoseReader
from scene4d.perception.orientation.fusion import fused, modal
from scene4d.perception.orientation.grid import Belief, crop_size
from scene4d.perception.orientation.network import OrientationNetwork

__all__ = ["Belief", "OrientationNetwork", "PoseReader", "crop_size", "fused", "modal"]
