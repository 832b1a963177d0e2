"""See a marker as a camera would: render it, detect its dots, and save the annotated picture.

python examples/see_a_view.py view.png
"""

import argparse
from pathlib import Path

from markergen.detect.presentation import overlay
from markergen.model.spec import Spec
from markergen.optimize.design import design
from markergen.render import Optics
from markergen.validation.views import SyntheticViews


def main(path: Path) -> None:
    """Design the default marker and view it once, at a steep angle, through a slightly blurred lens."""
    actual = design(Spec())
    setting = actual.setting
    series = SyntheticViews(actual.marker, setting.camera, setting.poses, count=3, optics=Optics(blur_px=1.0))
    view = series.take(1)
    path.write_bytes(overlay(view.image, [view.detection]))
    print(f"pose {view.pose}: {'found' if view.detection.ok else view.detection.reason}")
    print(f"largest error of a dot's center: {view.error_px.max():.4f} px")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("view.png"))
    main(parser.parse_args().path)
