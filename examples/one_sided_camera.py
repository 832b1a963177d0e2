"""Gain of an optimized layout over a regular polygon at its best phase, for a camera always on one side.

python examples/one_sided_camera.py 5
"""

import argparse

import markergen as mg

VOLUME = "cone:distance=0.6..1.5,tilt=40..70,azimuth=-30..30,roll=0"


def main(n: int) -> None:
    """Design n dots in a disk of 150 mm for the volume; print the expected displacement and what it costs elsewhere."""
    design = mg.design(n=n, radius="150mm", poses=VOLUME, dot="10mm")
    layout, polygon = (1e3 * design.criteria[name]["pose_m"] for name in ("design", "ngon"))
    for x, y, _ in 1e3 * design.marker.xyz:
        print(f"{x:8.1f} mm {y:8.1f} mm")
    print(f"{n} dots: {layout:.2f} mm, regular polygon: {polygon:.2f} mm, {100 * (1 - layout / polygon):.1f} % less")
    for key, name in (("rotation_deg", "rotation"), ("homography_px", "homography")):
        print(f"  {name}: {design.criteria['design'][key] / design.criteria['ngon'][key]:.2f} times the polygon's")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", type=int, nargs="?", default=5)
    main(parser.parse_args().n)
