"""Camera orientation from single pictures: focal length, tilt and roll, each as a distribution."""

from scene4d.perception.orientation.grid import Belief, crop_size, fused, modal
from scene4d.perception.orientation.network import OrientationNetwork, PoseReader

__all__ = ["Belief", "OrientationNetwork", "PoseReader", "crop_size", "fused", "modal"]
