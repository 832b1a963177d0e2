"""A program of a user who checks it with mypy --strict; `make lint` does, and nothing runs it."""

import markergen as mg

version: str = mg.__version__
print(version)
