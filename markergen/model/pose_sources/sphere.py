"""``sphere``: poses from all around the origin, for bodies with faces on all sides, such as the rig of a cube."""
# tests: tests/contracts/test_poses.py

from dataclasses import dataclass

from markergen.arrays import Array
from markergen.model.pose_sources.cone import Cone
from markergen.model.poses import POSES, PoseDistribution, PoseSource, pose_arguments

FORM = "sphere:distance=A..B,roll=A..B,count=N,seed=S,sampling=even|random"
KEYS = ("distance", "roll", "count", "seed", "sampling")

HEMISPHERE = "tilt=0..89.999999"
"""Tilt of the cone of which every other pose is turned over."""


@dataclass(frozen=True)
class Sphere:
    """Poses whose camera looks at the origin, from directions uniform over the whole solid angle.

    Those of a `Cone` over the upper hemisphere; every other one is for the body turned by half a turn about its x axis:
    the camera's center (x, y, z) becomes (x, -y, -z).

    Examples
    --------
    >>> import numpy as np
    >>> rotation, translation = Sphere.parse("sphere:distance=0.5..0.6m,count=200").sample()
    >>> center = -np.einsum("pij,pi->pj", rotation, translation)
    >>> bool((center[0::2, 2] > 0).all()), bool((center[1::2, 2] < 0).all())
    (True, True)
    """

    cone: Cone

    @staticmethod
    def parse(text: str) -> "Sphere":
        """Sphere of a text such as ``sphere:distance=0.4..1m,count=200``, in the forms of `Cone`; raises InputError."""
        arguments = pose_arguments(text, KEYS, FORM)
        return Sphere(
            Cone.parse(f"cone:{','.join([HEMISPHERE, *(f'{key}={value}' for key, value in arguments.items())])}")
        )

    def __str__(self) -> str:
        """Text that `parse` reads back, the same for equal spheres."""
        values = str(self.cone).partition(":")[2].split(",")
        return f"sphere:{','.join(item for item in values if item.partition('=')[0] in KEYS)}"

    def sample(self) -> tuple[Array, Array]:
        """Rotation (count, 3, 3) and translation (count, 3) in m of the poses T_camera_rig."""
        rotation, translation = self.cone.sample()
        rotation[1::2] *= [1.0, -1.0, -1.0]
        return rotation, translation


def _poses(text: str) -> PoseDistribution:
    sphere = Sphere.parse(text)
    return PoseDistribution(str(sphere), *sphere.sample())


POSES.register("sphere")(PoseSource(_poses, FORM))
