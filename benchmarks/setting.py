"""A contestant of `markergen compare` with settings that you name, in the same views.

    python -m benchmarks.setting checkerboard:9x9 "then cornerSubPix, half window 0.5 of the spacing"
    python -m benchmarks.setting pupil:36h11 "quad_decimate 1, quad_sigma 0.8" "image x4" --fit
    python -m benchmarks.setting charuco:5x5 --list

Rows are named as `--list` shows them; of tables without one the first is taken. `--fit` adds the same refiner for all,
from the pose of its detector. Errors are rotations in degrees.
"""

import argparse

import numpy as np

from markergen.comparison.baselines import line_up
from markergen.comparison.series import Observation, Series
from markergen.validation.metrics import rms


def main() -> None:
    """Print the tables of settings, or the errors of one setting."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("contestant", help="as for `markergen compare`")
    parser.add_argument("rows", nargs="*", help="rows of its tables")
    parser.add_argument("--views", type=int, default=100)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--fit", action="store_true")
    options = parser.parse_args()
    contestants, setting = line_up([options.contestant, "square"])
    contestant = contestants[0]
    if contestant.absent:
        parser.error(contestant.absent)
    if options.list:
        for name, rows in contestant.settings.items():
            print("\n    ".join([name, *rows]))
        return
    choice = {name: row for name, rows in contestant.settings.items() for row in rows if row in options.rows}
    if unknown := set(options.rows) - set(choice.values()):
        parser.error(f"rows that --list shows, found {', '.join(sorted(unknown))}")
    series = Series(tuple(contestants), setting.camera, setting.poses, options.views)
    finding = list[tuple[Observation, ...]]()
    for view in range(options.views):
        if options.fit:
            finding.append(series.observe_and_refine(0, choice, view))
        else:
            finding.append((series.observe(contestant, choice, view, series.photograph(contestant, view)),))
    print(f"{contestant.name}, {contestant.size}, by {contestant.describe(choice)}")
    for name, observations in zip(("detector", "fit"), zip(*finding, strict=True), strict=False):
        errors = np.array([observation.rotation_deg for observation in observations if observation.counts])
        median = np.median(errors) if len(errors) else np.nan
        print(f"{name} {len(errors)} of {options.views}, rms {rms(errors):.4f}, median {median:.4f}")


if __name__ == "__main__":
    main()
