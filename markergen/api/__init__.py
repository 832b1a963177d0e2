"""The functions of the library: each takes objects, paths or text, and returns a result."""
