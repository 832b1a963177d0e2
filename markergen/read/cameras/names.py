"""Names of what is in a camera file: those of OpenCV, ROS, other programs, and hand-written files."""

# tests: tests/read/test_camera_programs.py

from markergen.read.cameras.document import plain

NAMED = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Keys of single coefficients."""

KEYS: dict[str, tuple[str, ...]] = {
    "matrix": ("camera_matrix", "K", "intrinsic_matrix", "mtx", "M", "camera_intrinsics", "intrinsics_matrix",
               "intrinsic", "intrinsics", "matrix", "cam_K", "camera_intrinsic"),
    "coefficients": ("distortion_coefficients", "D", "dist_coeffs", "distortion_coeffs", "dist", "dist_coeff", "coeffs",
                     "distortion_coeff", "distortions", "distCoef", "distortion", "distortion_parameters",
                     "cameraExtrinsics", "distortion_coefs", "kc"),
    "radial": ("radial", "radial_distortion"),
    "tangential": ("tangential", "tangential_distortion"),
    "model": ("distortion_model",),
    "width": ("image_width", "width", "img_width", "w", "cols", "resolution_x"),
    "height": ("image_height", "height", "img_height", "h", "rows", "resolution_y"),
    "size": ("image_size", "resolution", "img_size", "camera_resolution", "image_resolution", "imagersize",
             "image_dimension", "size", "S"),
    "shape": ("image_shape", "img_shape", "shape"),
    "fx": ("fx", "fl_x", "focal_length_x"),
    "fy": ("fy", "fl_y", "focal_length_y"),
    "cx": ("cx", "ppx", "principal_point_x", "u0"),
    "cy": ("cy", "ppy", "principal_point_y", "v0"),
    "focal": ("focal_length", "focal_lengths", "focal", "fc", "camera_params"),
    "principal": ("principal_point", "center", "cc"),
    "part": ("x_offset", "y_offset", "height", "width"),
}  # fmt: skip
"""Keys by what they have, the first that messages name; `part` is the region of interest of a ROS message."""

SIDES = frozenset(map(plain, (*KEYS["width"], *KEYS["height"])))
KNOWN = frozenset(map(plain, NAMED)).union(*(map(plain, KEYS[name]) for name in KEYS if name != "part"))
"""What `plain` makes of the keys of sides, and of all."""
