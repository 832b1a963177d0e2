"""Read outlines from drawings, in formats that are recognized by content, not by name."""
