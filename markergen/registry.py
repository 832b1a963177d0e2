"""Tables of named things (objectives, estimators, exporters): a new entry is a new file."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from typing import Generic, TypeVar

from markergen.errors import InputError

T = TypeVar("T")


class Registry(Generic[T]):
    """Entries that register themselves when the modules of one package are imported.

    Parameters
    ----------
    kind : str
        What an entry is called in messages ("objective").
    package : str
        Dotted name of the package (or single module) that holds the entries; imported at the first look-up.
    """

    def __init__(self, kind: str, package: str) -> None:
        self.kind, self._package = kind, package
        self._entries: dict[str, T] = {}
        self._loaded = False

    def register(self, *names: str) -> Callable[[T], T]:
        """Decorate an entry to add it under each name; a name that is taken is a programming error."""

        def add(entry: T) -> T:
            for name in names:
                if name in self._entries:
                    raise ValueError(f"{self.kind} {name!r} is registered twice")
                self._entries[name] = entry
            return entry

        return add

    def names(self) -> list[str]:
        """Return all names, sorted."""
        self._load()
        return sorted(self._entries)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __getitem__(self, name: str) -> T:
        """Return the entry of that name.

        Raises
        ------
        InputError
            If there is none; the message lists the known names and the nearest.
        """
        self._load()
        if name in self._entries:
            return self._entries[name]
        near = get_close_matches(name, self._entries, n=1)
        hint = f"did you mean {near[0]!r}? Known: " if near else "known: "
        raise InputError(f"a known {self.kind}", repr(name), hint + ", ".join(self.names()))

    def _load(self) -> None:
        if self._loaded:
            return
        package = importlib.import_module(self._package)
        for module in pkgutil.iter_modules(getattr(package, "__path__", [])):
            importlib.import_module(f"{self._package}.{module.name}")
        self._loaded = True
