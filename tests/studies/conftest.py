import socket

import pytest
from dask_cluster import Cluster


@pytest.fixture
def cluster(tmp_path_factory):
    result = Cluster(tmp_path_factory.mktemp("cluster"), workers=2)
    yield result
    result.end()


@pytest.fixture
def strangers(tmp_path_factory):
    """A cluster that knows nothing of this project."""
    folder = tmp_path_factory.mktemp("strangers")
    # In place of what may be installed there.
    (folder / "markergen.py").write_text("raise ImportError('no markergen here')")
    result = Cluster(folder, workers=1, paths=[folder])
    yield result
    result.end()


@pytest.fixture
def mute_address():
    """Address of a port that takes connections and never says a word."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
