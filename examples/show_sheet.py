"""Show a picture of a sheet in the terminal, two dots of the picture for each character.

python examples/show_sheet.py marker.png
"""

import sys

import cv2
import numpy as np

WIDTH = 64


def main(path: str) -> None:
    """Print the sheet in blocks, its paper light."""
    sheet = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    if sheet is None:
        raise SystemExit(f"expected a picture at {path}, found none; markergen design -o {path} makes one")
    height = 2 * round(WIDTH * sheet.shape[0] / sheet.shape[1] / 2)
    light = cv2.resize(sheet, (WIDTH, height), interpolation=cv2.INTER_AREA) > 140
    for upper, lower in zip(light[::2], light[1::2], strict=True):
        print("  " + "".join(np.array([" ", "▄", "▀", "█"])[2 * upper + lower]))


if __name__ == "__main__":
    main(*sys.argv[1:])
