"""Table of contestants for `compare`: each kind of marker, tag or board in a file of its own."""

from markergen.comparison.contestants.base import (
    KINDS,
    Absent,
    Arena,
    Choice,
    Contestant,
    ContestantKind,
    Image,
    Pose,
    Sighting,
    forms,
    listed,
)

__all__ = [
    "KINDS",
    "Absent",
    "Arena",
    "Choice",
    "Contestant",
    "ContestantKind",
    "Image",
    "Pose",
    "Sighting",
    "forms",
    "listed",
]
