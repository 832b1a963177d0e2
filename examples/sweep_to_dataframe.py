"""Sweep over the number of dots and the noise, and view the table as a pandas DataFrame.

python examples/sweep_to_dataframe.py sweep
"""

import argparse
from pathlib import Path

import markergen as mg

SWEEP = {
    "dot": "30mm",
    "restarts": 4,
    "poses": "cone:distance=0.6..1.5m,tilt=0..60,count=60",
    "study": {"name": "How many dots, and how arranged", "runs": 20, "estimators": ["ippe", "lm"]},
    "grid": {"n": [4, 5, 6], "layout": ["designed", "random"], "noise": [0.2]},
}


def main(folder: Path) -> None:
    """Run the sweep on all processors and print the rotation error of LM against the number of dots."""
    study = mg.study(SWEEP, folder)
    table = study.to_frame()
    printed = table[(table.estimator == "lm") & (table.polar_angle_deg == "all")]
    print(printed.pivot(index="n", columns="layout", values="rotation_rms_deg").round(3))
    print(f"figures and page: {folder / 'index.html'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("sweep"))
    main(parser.parse_args().folder)
