"""Bodies of a made marker, as prisms and revolutions, and the outline of its plate."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def moved_module(home: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module that has moved; plug-ins of before find its names."""

    def attribute(name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(import_module(home), name)

    return attribute
