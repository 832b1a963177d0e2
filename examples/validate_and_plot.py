"""Validate a marker by trials and synthetic views, and plot the errors of each estimator relative to the bound.

python examples/validate_and_plot.py errors.png
"""

import argparse
from pathlib import Path

import markergen as mg


def main(path: Path, runs: int, views: int) -> None:
    """Design the default marker, validate it, print the result, and save the plot and the report."""
    marker = mg.design(n=5, radius="150mm").marker
    validation = mg.validate(marker, poses="cone:tilt=0..70,count=80", runs=runs, views=views)
    print(validation)
    print(f"no estimator can do better than {validation.bound['rotation_deg']:.3f} degrees RMS")
    validation.save(path, path.with_suffix(".html"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("errors.png"))
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--views", type=int, default=20)
    given = parser.parse_args()
    main(given.path, given.runs, given.views)
