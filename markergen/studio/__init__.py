"""The studio: a page in the browser, served to this computer alone, which shows what the library's functions return."""

from pathlib import Path

from markergen.errors import MissingLibraryError, install


def serve(file: Path | None = None, port: int | None = None, browser: bool = True) -> None:
    """Serve the studio; see `markergen.studio.server.run_server`.

    Raises
    ------
    MissingLibraryError
        If the extra ``studio`` is not installed.
    """
    try:
        from markergen.studio import server
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "markergen":
            raise
        raise MissingLibraryError(
            f"expected starlette and uvicorn for the studio, found no {error.name}; "
            f"install them with: {install('studio')}"
        ) from None
    server.run_server(file, port, browser)
