"""Camera orientation from single pictures: focal length, tilt and roll, each as a distribution."""
