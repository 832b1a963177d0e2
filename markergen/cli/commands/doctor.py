"""``markergen doctor``."""
# tests: tests/contracts/test_commands.py

from markergen.cli import console
from markergen.cli.options import Json


def doctor(json: Json = None) -> None:
    """Show versions, the flavor of OpenCV and whether it has windows, the compiler, and what commands lack.

    \b
    Example:
      markergen doctor
    """
    from markergen.api.doctor import diagnosis

    console.print_result(diagnosis(console.file_of(json)), json)
