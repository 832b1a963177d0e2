"""A landing pad for a drone that comes down from 10 to 0.3 m: dots of several sizes, and what is seen on the way.

python examples/landing_pad.py pad
"""

import argparse

import numpy as np

import markergen as mg
from markergen.maths.rotation import angle_between
from markergen.model.poses import named_poses
from markergen.render import Optics, render_view

CAMERA = mg.Camera(640, 480, 800, 800, 320, 240)


def main(name: str) -> None:
    """Design the pad, and print how well the drone's pose is found at some heights in rendered views."""
    volume = "cone:distance=0.3..10m,tilt=0..45"
    design = mg.design(n="auto", radius="500mm", poses=volume, output=f"{name}.json", coverage=f"{name}.svg")
    print(design)
    detector = mg.Detector(design.marker, CAMERA)
    for height in (9, 3, 1, 0.4):
        there = named_poses(f"cone:distance={height},tilt=20,count=1")
        rotation, translation = there.rotation[0], there.translation[0]
        image = render_view(design.marker, CAMERA, rotation, translation, Optics(), np.random.default_rng(0))
        seen = detector(image)[0]
        assert seen.pose
        off = np.rad2deg(angle_between(seen.pose.rotation, rotation))
        print(f"{height} m: {len(seen.ids)} dots, rotation off by {off:.4f} deg")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", default="pad")
    main(parser.parse_args().name)
