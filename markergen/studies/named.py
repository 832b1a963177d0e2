"""Studies known by name: packages that use markergen, and enter this table as plug-ins do."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from markergen.registry import Registry


@dataclass(frozen=True)
class NamedStudy:
    """A study that is asked for by its name.

    Attributes
    ----------
    options : type
        Dataclass of the choices that it leaves to users; those named as keywords of `markergen.study` are taken from
        there. Refuses what cannot be.
    run : callable
        ``run(folder, options, engine=..., resume=..., progress=...)`` computes it into a folder and returns the paths
        of what it wrote.
    seconds : callable
        ``seconds(options, workers)``: about how long that takes.
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
