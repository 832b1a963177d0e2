"""Bodies of a made marker, as prisms and revolutions, and the outline of its plate."""

import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any


def renamed(name: str, home: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module that has moved: its names, with a DeprecationWarning."""

    def attribute(attribute_name: str) -> Any:
        if attribute_name.startswith("__"):
            raise AttributeError(attribute_name)
        warnings.warn(f"{name} is now {home}", DeprecationWarning, stacklevel=2)
        return getattr(import_module(home), attribute_name)

    return attribute
