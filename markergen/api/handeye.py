"""``markergen.handeye``: a camera on a robot or beside it, by photographs of a marker and the robot's poses."""

# tests: tests/api/test_handeye.py

from pathlib import Path
from typing import Any, Unpack

import numpy as np

from markergen.api.arguments import files_among, known_camera, marker_of
from markergen.calibration.calibration import Known
from markergen.calibration.handeye import MOUNTINGS, HandEye, solve
from markergen.calibration.network import Pose
from markergen.errors import InputError
from markergen.model.rig import planned_print
from markergen.options import Progress, as_list, check_progress, settle, takes
from markergen.options.calibration import HandeyeKeywords
from markergen.options.kinds import CameraLike, File, Files, MarkerLike
from markergen.pool import OneBlasThread
from markergen.read.images import find_images
from markergen.read.robot_poses import RobotConvention, robot_poses


@takes(HandeyeKeywords)
@OneBlasThread()
def handeye(
    marker: MarkerLike,
    photos: Any,
    robot: Any,
    camera: CameraLike | None = None,
    *,
    save: Files = (),
    json: File | None = None,
    progress: Progress | None = None,
    **options: Unpack[HandeyeKeywords],
) -> HandEye:
    """Find where a camera is on a robot, or beside it, by photographs of a marker and the robot's poses in them.

    In the photographs k, T_base_flange,k T_flange_camera T_camera_marker,k = T_base_marker of a camera on the hand, and
    T_base_flange,k T_flange_marker = T_base_camera T_camera_marker,k of one beside the robot. The poses of all
    photographs, the dots, the camera if it is not exact, and the scale between marker and robot are adjusted together;
    see docs/handeye.md.

    Parameters
    ----------
    marker : Marker, path or dict
        As designed, or as measured by `calibrate`.
    photos : path, folder, pattern, image, or several of these
        Photographs of one size; an image is an array (h, w) or (h, w, 3) in BGR.
    robot : path or array (k, 4, 4)
        A table with a column that names the photograph; a folder, or a pattern, of files with a pose beside each; or
        matrices T_base_flange in m of the photographs in order, where nothing else is stated.
    camera : Camera, path, dict or None
        Exact, unless there is a covariance; None: it is estimated, too.
    save : path or list of paths
        Files to write, by suffix: .json for the results, .svg or .png for the plot.
    json : path or None
        File for the results as JSON.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    **options
        As on the command line, ``markergen handeye --help``, with underscores.

    Returns
    -------
    HandEye

    Raises
    ------
    InputError
        If an argument is wrong; direction, unit or rotation of the poses are not stated; fewer than three photographs
        have a pose and show the marker; the robot turned about parallel axes; or photographs have each other's poses.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import markergen as mg
    >>> import numpy as np
    >>> from markergen.maths.rotation import exponential
    >>> from markergen.render import Optics, render_view
    >>> marker = mg.design(n=5, radius="60mm", dot="16mm", restarts=2).marker
    >>> camera = mg.Camera(320, 240, 400, 400, 159.5, 119.5)
    >>> tilts = [[0.5, 0, 0], [-0.5, 0, 0], [0, 0.5, 0], [0, -0.5, 0], [0.4, 0.4, 0.5], [-0.4, 0.4, 1]]
    >>> flange = np.tile(np.eye(4), (6, 1, 1))  # Here the camera's frame is the flange's, the marker's the base.
    >>> flange[:, :3, :3] = np.swapaxes(exponential(np.array(tilts)) @ np.diag([1.0, -1.0, -1.0]), 1, 2)
    >>> flange[:, :3, 3] = -flange[:, :3, 2] * [[0.3], [0.32], [0.34], [0.3], [0.36], [0.38]]
    >>> rng = np.random.default_rng(0)
    >>> views = [(pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]) for pose in flange]
    >>> photos = [render_view(marker, camera, *view, Optics(), rng) for view in views]
    >>> result = mg.handeye(marker, photos, flange, camera)
    >>> bool(np.linalg.norm(result.camera_pose[1]) < 1e-3)
    True
    """
    check_progress(progress)
    settled = settle(options, HandeyeKeywords)
    if settled["mounting"] not in MOUNTINGS:
        raise InputError(f"the mounting {' or '.join(MOUNTINGS)}", repr(settled["mounting"]), "see --help")
    convention = RobotConvention(*(settled[f"robot_{key}"] for key in ("frame", "unit", "rotation", "angle")))
    design = marker_of(marker)
    file, taken, covariance = known_camera(camera, photos, settled)
    targets = HandEye.targets(save, json=json)
    targets.check(files_among(marker, file, robot, settled["camera_covariance"]))
    sources, flange = _posed(photos, robot, convention)
    sigma = planned_print(design) if settled["print_sigma"] is None else settled["print_sigma"]
    on_hand, prior = settled["mounting"] == MOUNTINGS[0], Known(taken, covariance, print_sigma=sigma)
    result = solve(design, sources, flange, on_hand, settled["one_axis"], prior, settled["workers"], progress)
    return result.saved(targets)


def _posed(photos: Any, robot: Any, convention: RobotConvention) -> tuple[list[Any], dict[int, Pose]]:
    """Photographs, and T_base_flange of those that have one."""
    sources: list[Any] = [photos] if isinstance(photos, np.ndarray) and photos.ndim < 4 else list(as_list(photos))
    if not (sources and isinstance(sources[0], np.ndarray)):
        sources = list(find_images([*map(str, sources)]))
    if isinstance(robot, str | Path):
        if isinstance(sources[0], np.ndarray):
            raise InputError(
                "matrices of the robot's poses with images as arrays", str(robot), "give paths of photographs"
            )
        return sources, robot_poses(robot, sources, convention)
    try:
        matrices = np.array(robot, dtype=float)
    except (TypeError, ValueError):
        matrices = np.empty(0)
    if matrices.shape != (len(sources), 4, 4):
        raise InputError(
            f"a path, or matrices ({len(sources)}, 4, 4) of T_base_flange, one for each photograph",
            f"{type(robot).__name__} of shape {matrices.shape}",
            "give one matrix for each photograph, in their order",
        )
    return sources, {k: (pose[:3, :3], pose[:3, 3]) for k, pose in enumerate(matrices)}
