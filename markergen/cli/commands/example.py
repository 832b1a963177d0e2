"""``markergen example``."""
# tests: tests/api/test_example.py

from typing import Annotated

import typer

from markergen.cli import console


def example(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Example to copy; without it, list all.")] = None,
    folder: Annotated[
        str, typer.Argument(metavar="FOLDER", help="Folder to copy it into; by default, this one.", show_default=False)
    ] = ".",
) -> None:
    """Copy an example script, a notebook, a package for ROS 2, or a template out of the installation.

    \b
    Example:
      markergen example
      markergen example first_marker
    """
    from markergen.api.shipped import copied_example, examples, summary_of

    if name is None:
        for entry, path in sorted(examples().items(), key=lambda item: item[1].suffix):
            console.report(f"{entry:24} {path.suffix[1:] or 'package':8}{summary_of(path)}")
        return
    for file in copied_example(name, folder).written:
        console.report(str(file))
