#!/bin/sh
# The main job from start to end: design, print, prove, make, find. `make demo` calls this with the folder to write to.
set -eu
examples=$(cd "$(dirname "$0")" && pwd)
folder=${1:-out}
mkdir -p "$folder"
cd "$folder"
say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

say "1. Design a marker with 5 control points in a disk of 0.15 m, and draw it at true size"
markergen design --n 5 --radius 0.15 -o marker.pdf

say "2. Prove it: 400 poses x 1000 noisy runs x 5 estimators, and 100 synthetic views, about a minute"
markergen validate marker.json --report report.html --json validation.json

say "3. Make it as solids and as drawings, and check every file against marker.json"
markergen export marker.json -o marker.step -o marker.3mf -o marker.fab.pdf -o marker.dxf

markergen verify marker.json marker.pdf marker.step marker.3mf marker.dxf

say "4. Take photos of it in clutter, through a wide lens, and find it in them"
python "$examples/take_photos.py" marker.json photos
markergen detect photos --marker marker.json --camera photos/camera.yaml --json found.json --overlay seen

say "What you have now, in $(pwd)"
cat <<'END'
  marker.pdf       the marker at true size: print at 100 % on A2 and check the rulers
  marker.json      the marker itself: every point, what it was designed for, and how good it is
  report.html      what to expect of it and what limits it: open it in a browser
  validation.json  the same for programs: what each estimator makes of it, with the bounds beside
  marker.step      a plate and its inlays as named, colored solids, in mm
  marker.3mf       the same in two materials for a 3-D printer's slicer
  marker.fab.pdf   the drawing for a workshop: dimensions, coordinates, tolerances
  marker.dxf       the face for a laser cutter: exact circles
  seen/            the photos with what was found drawn in; found.json has the poses with their covariance
END
