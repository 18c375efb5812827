"""Footage in: sources of frames, sampling, undistortion, the moving-camera check, the sample clip.

Import the modules themselves (``scene4d.video.reader`` and so on): they load PyAV and OpenCV,
which this package does not.
"""
