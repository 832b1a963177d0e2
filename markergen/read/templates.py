"""Ready-made specs: those that are shipped, and TOML files of a user's own."""

import tomllib
from pathlib import Path
from typing import Any

from markergen.errors import InputError
from markergen.files import shipped_folder
from markergen.guard import read, text_of


def read_template(name: str) -> dict[str, Any]:
    """Values of a template: the name of one that is shipped (see `templates`), or the path of a TOML file.

    Raises
    ------
    InputError
        If there is no such template or the file is not TOML.
    """
    try:
        return tomllib.loads(template_text(name))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"TOML in {name}", str(error), "correct the file") from None
    except (ValueError, RecursionError):
        raise InputError(f"TOML in {name}", "an endless number or endless nesting", "correct the file") from None


def template_text(name: str) -> str:
    """Text of a template, as `read_template` finds it, comments and all."""
    known = templates()
    path = Path(name)
    if path.suffix != ".toml" and name not in known:
        raise InputError("a known template or a .toml file", repr(name), f"known: {', '.join(known)}")
    return text_of(read(known.get(name, path), "spec"))


def templates() -> dict[str, Path]:
    """Shipped templates by name, whether markergen runs from a wheel or from a checkout."""
    return {path.stem: path for path in sorted(shipped_folder("templates").glob("*.toml"))}
