"""What could be taken for another layout: as a camera sees it, with perspective, and as from far away, by affine maps.

`perspective` is exact and in px, for the poses of a setting. `affine` is fast and in m, for any pose from far away.
"""
