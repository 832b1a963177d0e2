"""``paper`` and ``paper-roll``: the poses of Acuna & Willert (2018)."""
# tests: tests/contracts/test_poses.py

from markergen.model.poses import POSES, PoseSource, paper, paper_roll

POSES.register("paper")(PoseSource(lambda _: paper()))
POSES.register("paper-roll")(PoseSource(lambda _: paper_roll()))
