"""Terms of the reports on markers and rigs: frames, errors, bounds, and what is left out."""
# tests: tests/api/test_validate.py

POSE_ERRORS = [
    ("Rotation error (RE)", "Angle of R_hatᵀ R, in degrees."),
    ("Translation error (TE)", "|t_hat - t| / |t|, in percent; in mm where it says so."),
]

MARKER = [
    (
        "Marker frame",
        "Meters; x right, y up, z out of the printed face toward the viewer; the origin is the center of the "
        "boundary's smallest enclosing circle.",
    ),
    ("Camera frame", "x right, y down, z forward. Pixel centers are at integer coordinates."),
    (
        "Pose",
        "T_camera_marker: X_camera = R X_marker + t. Tilt is the angle between the marker's normal and the direction "
        "to the camera; 0 is frontal.",
    ),
    *POSE_ERRORS,
    (
        "Homography error (HE)",
        "Mean over a grid half as wide again as the marker of the squared distance, px²; its root in px stands beside "
        "it.",
    ),
    (
        "Bound (CRLB)",
        "The Cramér-Rao bound, to first order: no unbiased estimator is better. Far frontal poses are "
        "beyond first order: errors there are larger or smaller.",
    ),
    (
        "Efficiency",
        "Mean square of the bound over that of the measured error, without flips; left out where the bound on the "
        "rotation exceeds 2.5 degrees.",
    ),
    (
        "Excluded",
        "Failures: an estimate that is not finite, puts a point behind the camera, or has a TE over 100 %. Flips (the "
        "mirrored pose is nearer than the true one) stay in.",
    ),
    (
        "RMS over poses",
        "Root of the mean of squares, each pose counting the same. Frontal poses usually make the most of it, so see "
        "the errors by tilt as well.",
    ),
    (
        "Expected errors",
        "From the covariance to first order where that holds; elsewhere (few pixels, frontal poses, another pose that "
        "fits as well) the estimator's own errors, sampled, with flips.",
    ),
    (
        "Error budget",
        "To first order: what noise in the image, misplaced dots, and errors of the calibration make of the pose, "
        "weighed by their covariances. Not in it: a bent sheet, motion blur, and a wrong scale of "
        "a print that was not measured.",
    ),
]

RIG = [
    ("Pose", "T_camera_rig: X_camera = R X_rig + t, in meters. Camera frame: x right, y down, z forward."),
    (
        "In view",
        "A dot counts if no part of it is hidden by a plate or beyond the image's edge, and its image is large enough "
        "to be found. A plate is in view if one of its dots is; a pose counts if one plate shows four.",
    ),
    (
        "Best alone",
        "The pose of the rig from the dots of one plate: to first order and in trials of the plate with the least "
        "bound, in views of the plate whose own detection claims the least error.",
    ),
    (
        "Errors to expect",
        "To first order, of the estimate that weights each dot by its own noise from image, print and the plates' "
        "relation; the errors that dots of a plate share by that relation are counted as they are.",
    ),
    *POSE_ERRORS,
    (
        "Flips",
        "The mirrored pose of a plate is nearer than its true one. Other plates settle which of the two it is.",
    ),
    ("NEES", "Squared error in units of the claimed covariance: 6 on average if that is right."),
]
