"""Camera orientation from single pictures: focal length, tilt and roll, each as a distribution."""

from scene4d.perception.orientation._network import OrientationNetwork, PoseReader
from scene4d.perception.orientation.grid import Belief, crop_size, fused, modal

__all__ = ["Belief", "OrientationNetwork", "PoseReader", "crop_size", "fused", "modal"]
