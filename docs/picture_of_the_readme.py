"""Draw the README's picture: a marker designed in the terminal, its sheet, and a photograph in which it is found.

python -m docs.picture_of_the_readme docs/images/first.png
"""

import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import cv2

TAKE = Path(__file__).parents[1] / "examples" / "take_photos.py"
COMMAND = "design --paper A4 -o marker.pdf"
SHEET = "export marker.json --paper A4 -o marker.png --dpi 80"
FOUND = "detect photos --marker marker.json --camera photos/camera.yaml --overlay seen"
LINES = 44
"""Characters of a line in the terminal's picture."""


def main(target: str) -> None:
    """Run the commands in an empty folder, and draw what they make side by side."""
    from matplotlib.figure import Figure

    with tempfile.TemporaryDirectory() as folder:

        def run(*arguments: str | Path) -> str:
            command = [sys.executable, *arguments]
            return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout

        answer = run("-m", "markergen", *COMMAND.split())
        run("-m", "markergen", *SHEET.split())
        run(TAKE, "marker.json", "photos")
        run("-m", "markergen", *FOUND.split())
        sheet = cv2.imread(f"{folder}/marker.png")
        photo = cv2.imread(str(sorted(Path(folder, "seen").iterdir())[1]))
    lines = [f"$ markergen {COMMAND}", *answer.splitlines()[:4]]
    text = "\n".join("\n".join(textwrap.wrap(line, LINES, subsequent_indent="  ")) for line in lines)
    figure = Figure((11, 3.3), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=[1.25, 0.78, 1.45])
    axes[0].text(0.03, 0.5, text, family="monospace", fontsize=8.2, va="center", linespacing=1.45, color="#e8eaee")
    axes[0].set_facecolor("#15171b")
    axes[1].imshow(sheet[..., ::-1])
    axes[2].imshow(photo[..., ::-1])
    for axis, title in zip(axes, ("designed", "printed", "found"), strict=True):
        axis.set(xticks=[], yticks=[])
        axis.set_title(title, fontsize=11)
        axis.set_anchor("N")
    figure.savefig(Path(target), dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    main(sys.argv[1])
