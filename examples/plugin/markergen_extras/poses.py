"""``--poses helix:turns=3,count=60``: a camera that spirals down around the marker and looks at its origin."""

import numpy as np

from markergen.errors import InputError
from markergen.model.poses import PoseDistribution, PoseSource, pose_arguments

FORM = "helix:turns=N,count=N"


def helix(text: str) -> PoseDistribution:
    """From 10 to 60 degrees of tilt at a distance of 1 m, with the given numbers of turns and poses."""
    stated = {"turns": "3", "count": "60"} | pose_arguments(text, ["turns", "count"], FORM)
    if not all(value.isdecimal() and 0 < int(value) <= 10_000 for value in stated.values()):
        raise InputError("whole numbers of 1 to 10000 for a helix", repr(text), f"write {FORM}")
    turns, count = int(stated["turns"]), int(stated["count"])
    along = np.linspace(0, 1, count)
    tilt, azimuth = np.deg2rad(10 + 50 * along), 2 * np.pi * turns * along
    toward = np.stack([np.cos(azimuth) * np.sin(tilt), np.sin(azimuth) * np.sin(tilt), np.cos(tilt)], axis=-1)
    right = np.stack([-np.sin(azimuth), np.cos(azimuth), 0 * azimuth], axis=-1)
    rotation = np.stack([right, np.cross(-toward, right), -toward], axis=-2)
    # Parsing the name yields the same poses.
    return PoseDistribution(f"helix:turns={turns},count={count}", rotation, np.tile([0.0, 0.0, 1.0], (count, 1)))


HELIX = PoseSource(helix, FORM)
