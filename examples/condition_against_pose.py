"""Compare the paper's objective with ours on the same task: where they agree, and where they differ.

python examples/condition_against_pose.py
"""

import argparse

import markergen as mg


def main(counts: list[int]) -> None:
    """Design bare points with both objectives and print the RMS rotation bound of each, for noise of 1 px."""
    print(" n  condition  pose   regular polygon   (RMS rotation bound in degrees)")
    for n in counts:
        bounds = {}
        for objective in ("condition", "pose"):
            design = mg.design(n=n, objective=objective, dot=0, clearance=0)
            bounds[objective] = design.criteria["design"]["rotation_deg"]
            bounds["ngon"] = design.criteria["ngon"]["rotation_deg"]
        print(f"{n:>2} {bounds['condition']:>10.3f} {bounds['pose']:>6.3f} {bounds['ngon']:>11.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", type=int, nargs="*", default=[4, 5, 6, 8])
    main(parser.parse_args().n)
