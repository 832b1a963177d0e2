"""Table of the formats that a whole rig is written in, one module for each, as in `markergen.exporters.formats`."""
