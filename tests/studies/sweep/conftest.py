import pytest

SMALL = """
dot = "30mm"
poses = "cone:distance=0.6..1m,tilt=0..60,count=8,seed=1"

restarts = 1

[study]
name = "Small"
runs = 5
estimators = ["dlt", "lm"]

[grid]
n = [4, 5]
layout = ["random", "designed"]
noise = [0.2, 0.5]
"""


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """File of a sweep of eight points that takes a second or two."""
    path = tmp_path_factory.mktemp("spec") / "small.toml"
    path.write_text(SMALL)
    return path
