"""Named studies: packages that use markergen, and enter this table like plug-ins."""

# tests: tests/contracts/test_plugins.py

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from markergen.registry import Registry


@dataclass(frozen=True)
class NamedStudy:
    """Study that users request by name.

    Attributes
    ----------
    options : type
        Dataclass of its user options; those that are keywords of `markergen.study` are taken from there. Rejects
        invalid values.
    run : callable
        ``run(folder, options, engine=..., resume=..., progress=...)`` runs it in a folder and returns the paths of the
        files that it wrote.
    seconds : callable
        ``seconds(options, workers)``: estimate of its run time.
    """

    options: type
    run: Callable[..., list[Path]]
    seconds: Callable[[Any, int | None], float]

    @property
    def keywords(self) -> tuple[str, ...]:
        """Names of its options."""
        return tuple(field.name for field in fields(self.options))


STUDIES: Registry[NamedStudy] = Registry("study", "markergen.studies.checkout", "markergen.studies", NamedStudy)
"""Studies by name; ``paper`` comes from the package ``markergen_paper``, which has an entry point."""
