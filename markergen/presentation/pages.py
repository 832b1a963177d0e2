"""HTML pages that load only files stored beside them; all text is escaped."""

import base64
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from markergen.errors import InputError

_JPEG_QUALITY = 90
_SMALL_PNG = 60_000
"""Maximum size in bytes of a picture kept as PNG; noise makes most views larger, and a report has a dozen of them."""


def page_bytes(template: str, values: Mapping[str, Any]) -> bytes:
    """Fill in a jinja2 template and return the page in UTF-8; equal values give equal bytes.

    Parameters
    ----------
    template : str
        Text of the template; lines with only a statement leave no line in the page. It may extend ``frame.html.j2``,
        the page of all reports, and import from ``parts.html.j2``, their figures and tables.
    values : mapping
        Values are escaped unless the template marks them as safe, which is allowed for our own drawings.

    Raises
    ------
    jinja2.UndefinedError
        If the template names a value that is missing.

    Examples
    --------
    >>> page_bytes("<p>{{ text }}</p>", {"text": "a<b"})
    b'<p>a&lt;b</p>'
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(lambda name: files("markergen.presentation").joinpath(name).read_text("utf-8")),
    )
    # JSON allows lone surrogates, which UTF-8 cannot encode.
    return environment.from_string(template).render(values).encode("utf-8", "replace")


def data_uri(png: bytes) -> str:
    """Return PNG bytes as a data URI; noisy pictures become JPEG, a fifth of the size."""
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
    """Reject a file name whose suffix is not that of an HTML page.

    Raises
    ------
    InputError
        If the path ends neither in .html nor in .htm.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError("a page .html", str(path), "name the report so that a browser opens it")
