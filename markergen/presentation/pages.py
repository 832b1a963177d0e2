"""Pages of HTML that load nothing from elsewhere but what lies beside them; all text is escaped."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markergen.errors import InputError

_JPEG_QUALITY = 90
_SMALL_PNG = 60_000
"""Bytes up to which a picture is left as it is; noise makes larger ones of most views, and a report has a dozen."""


def page_bytes(template: str, values: Mapping[str, Any]) -> bytes:
    """Fill in a template of jinja2 and return the page in UTF-8; the same bytes for the same values.

    Parameters
    ----------
    template : str
        The text itself; lines that hold nothing but a statement leave no line.
    values : mapping
        Every value is escaped, unless the template marks it as safe, as it may our own drawings.

    Raises
    ------
    jinja2.UndefinedError
        If the template names a value that is missing.

    Examples
    --------
    >>> page_bytes("<p>{{ text }}</p>", {"text": "a<b"})
    b'<p>a&lt;b</p>'
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    # A lone surrogate, which JSON allows, has no UTF-8.
    return environment.from_string(template).render(values).encode("utf-8", "replace")


def data_uri(png: bytes) -> str:
    """Return PNG bytes as a data URI; pictures full of noise as JPEG, which takes a fifth of the room."""
    import cv2
    import numpy as np

    kind, data = "png", png
    if len(png) > _SMALL_PNG:
        image = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
        jpeg = bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])
        if len(jpeg) < len(png):
            kind, data = "jpeg", jpeg
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def check_page(path: Path) -> None:
    """Refuse a name whose ending promises something else than a page.

    Raises
    ------
    InputError
        If the path ends neither in .html nor in .htm.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError("a page .html", str(path), "name the report so that a browser opens it")
