"""``markergen example``."""
# tests: tests/api/test_example.py

from typing import Annotated

import typer

from markergen.cli import console


def example(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Example to copy; without it, list all.")] = None,
    folder: Annotated[str, typer.Argument(metavar="[FOLDER]", help="Where to.", show_default=False)] = ".",
) -> None:
    """Copy an example script, a notebook, a package for ROS 2, or a template out of the installation.

    \b
    Example:
      markergen example
      markergen example first_marker
    """
    from markergen.api.example import copied_example, examples

    if name is None:
        console.report("\n".join(f"{name:26}{path.suffix[1:] or 'package'}" for name, path in examples().items()))
        return
    for file in copied_example(name, folder).written:
        console.report(str(file))
