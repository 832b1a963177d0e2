"""Data model: boundary, camera, poses, features, marker, spec; and marker.json."""
