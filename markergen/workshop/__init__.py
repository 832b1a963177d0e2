"""The workshop: what a machine makes of a marker or rig, its solids, meshes and drawings."""
