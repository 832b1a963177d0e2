"""What everything passes around: boundary, camera, poses, features, marker, spec; and marker.json."""
