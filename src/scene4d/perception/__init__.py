"""Finding people in pictures: weights, detectors, keypoints, tracks. Import the submodules."""
