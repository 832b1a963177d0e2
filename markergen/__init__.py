"""Design fiducial markers: the layout of control points that gives the most accurate pose, proved."""

__version__ = "0.1.0"
