"""The camera and poses in which a marker or rig is judged: those that it was designed for, or others."""
# tests: tests/validation/test_pads.py tests/validation/test_validation.py

import numpy as np

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.model.sight import partly_seen, poses_that_serve
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.objectives.base import Sight
from markergen.read.poses import poses_from
from markergen.read.remarks import remark
from markergen.read.spec_file import spec_of, stated_poses

ALL_AROUND = "sphere:distance=0.3..0.9"
"""Poses of a rig whose file states none."""

MOST_RUNS = 1_000_000
"""Maximum number of trials at a pose; an RMS error of as many is uncertain by 0.07 %."""
MOST_NOISE_PX = 1000.0
"""Maximum noise, larger than any image; estimates are meaningless long before."""


def setting_of(
    body: Marker | Rig, poses: str | PoseDistribution | None = None, camera: Camera | None = None
) -> Setting:
    """Return the camera and poses that a marker or rig was designed for, or others: in any form for `poses_from`.

    A marker whose file does not state its setting is judged in the paper's, a rig by the paper's camera from all
    around. Poses that do not see a marker are left out; those of a rig all stay.

    Raises
    ------
    InputError
        If the poses or the camera are unknown, or no pose sees the entire marker.
    """
    if body.frame == "rig":
        if poses is None:
            try:
                poses = stated_poses(body.provenance.get("poses", ALL_AROUND))
            except ValueError as error:
                expected = "poses that a rig can have been made for"
                raise InputError(expected, str(error), "correct its provenance") from None
        stated = body.provenance.get("camera")
        camera = camera or (Camera.load(stated) if stated else PAPER_CAMERA)
        return setting_for(body, camera, poses_from(poses).placed(camera))
    spec = spec_of(body) or Spec()
    distribution = poses_from(spec.poses if poses is None else poses)
    camera = camera or spec.camera
    seen = poses_that_serve(body, camera, distribution)
    if seen.doubt:
        remark(seen.doubt)
    return setting_for(body, camera, seen)


def setting_for(body: Marker | Rig, camera: Camera, poses: PoseDistribution) -> Setting:
    """Return the setting in which poses see all of a marker, or a part of a rig or of dots of several sizes.

    Its boundary is that of the marker, or the disk as large as the rig.
    """
    boundary = body.boundary if isinstance(body, Marker) else Circle(body.radius)
    seen = partly_seen(body, camera, poses)
    sight = None if seen is None else Sight(seen, np.zeros((len(poses), 6, 6)))
    return Setting(boundary, camera, poses, sight=sight)


def check_trials(noise_px: float, runs: int, seed: int) -> None:
    """Refuse noise, runs or a seed out of range; raises InputError."""
    if not 0 <= noise_px <= MOST_NOISE_PX:
        expected = f"a noise from 0 to {MOST_NOISE_PX:g} px"
        raise InputError(expected, f"noise={noise_px}", "give --noise a number such as 0.2")
    if not 0 <= runs <= MOST_RUNS:
        raise InputError(f"0 to {MOST_RUNS} runs", f"runs={runs}", "give --runs a whole number such as 1000")
    if seed < 0:
        raise InputError("a seed of 0 or more", f"seed={seed}", "give a non-negative whole number")
