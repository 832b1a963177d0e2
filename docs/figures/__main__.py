"""Make the figures of the book and print the tables beside them: python -m docs.figures [PAGE...] [-o DIR]."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from importlib import import_module
from pathlib import Path

from docs.figures import IMAGES

PAGES = "choosing", "error", "handeye", "theory"


def main() -> None:
    """Make the figures of the given pages, or of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=", ".join(PAGES))
    parser.add_argument("-o", "--output", type=Path, default=IMAGES, metavar="DIR", help="folder for the SVG files")
    options = parser.parse_args()
    if unknown := set(options.pages) - set(PAGES):
        parser.error(f"no page {', '.join(sorted(unknown))}: there are {', '.join(PAGES)}")
    options.output.mkdir(parents=True, exist_ok=True)
    for page in options.pages or PAGES:
        import_module(f"docs.figures.{page}").make(
            lambda name, svg: (options.output / f"{name}.svg").write_text(svg, encoding="utf-8")
        )


if __name__ == "__main__":
    main()
