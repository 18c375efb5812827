"""Pure functions of arrays: rotations, projection, distortion, homographies, alignment."""

from scene4d.core.geometry.alignment import rigid_fit
from scene4d.core.geometry.distortion import (
    NO_DISTORTION,
    distort,
    distort_fisheye,
    opencv_from_tsai,
    refocused,
    straightening_slopes,
    undistort,
    undistort_fisheye,
)
from scene4d.core.geometry.homography import apply_homography, pose_from_homography
from scene4d.core.geometry.projection import (
    camera_centre,
    horizon_line,
    locate,
    project,
    projection_matrix,
    vertical_vanishing_point,
)
from scene4d.core.geometry.rotation import (
    R_OVERHEAD,
    is_rotation,
    quaternion_from_rotation,
    rotation_from_euler_zyx,
    rotation_from_quaternion,
    rotation_from_tilt_roll,
    rotation_vector,
    tilt_roll_from_rotation,
)

__all__ = [
    "NO_DISTORTION",
    "R_OVERHEAD",
    "apply_homography",
    "camera_centre",
    "distort",
    "distort_fisheye",
    "horizon_line",
    "is_rotation",
    "locate",
    "opencv_from_tsai",
    "pose_from_homography",
    "project",
    "projection_matrix",
    "quaternion_from_rotation",
    "refocused",
    "rigid_fit",
    "rotation_from_euler_zyx",
    "rotation_from_quaternion",
    "rotation_from_tilt_roll",
    "rotation_vector",
    "straightening_slopes",
    "tilt_roll_from_rotation",
    "undistort",
    "undistort_fisheye",
    "vertical_vanishing_point",
]
