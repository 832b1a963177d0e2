"""Writers of solids, meshes, simulator models, outlines to cut and the fabrication drawing."""
