"""Files to read."""

import pytest


@pytest.fixture
def write(request, tmp_path):
    """Write a file, under the name `FILE` of the test's module unless it is given another."""

    def write(content, name=getattr(request.module, "FILE", "drawing")):  # noqa: B008
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write
