"""``cone``: poses that look at the origin from ranges of distance, tilt, azimuth and roll."""

from markergen.model.cone import FORM, Cone
from markergen.model.poses import POSES, PoseDistribution, PoseSource


def _poses(text: str) -> PoseDistribution:
    cone = Cone.parse(text)
    return PoseDistribution(str(cone), *cone.sample())


POSES.register("cone")(PoseSource(_poses, FORM))
