"""``markergen validate``."""


def validate() -> None:
    """Placeholder until trials are there."""
