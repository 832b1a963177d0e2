#!/bin/sh
# The main workflow: design, print, validate, make, detect, measure. `make demo` runs this with the output folder.
set -eu
examples=$(cd "$(dirname "$0")" && pwd)
folder=${1:-out}
mkdir -p "$folder"
cd "$folder"
say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

say "1. Design a marker that fills the page in the printer"
markergen design -o marker.pdf -o marker.png
python "$examples/show_sheet.py" marker.png

say "2. Validate it: 400 poses x 50 noisy runs x 5 estimators, and 100 synthetic views, 20 s"
markergen validate marker.json --runs 50 --report report.html --json validation.json

say "3. Make it as solids and as drawings, and check every file against marker.json"
markergen export marker.json -o marker.step -o marker.3mf -o marker.fab.pdf -o marker.dxf

markergen verify marker.json marker.pdf marker.step marker.3mf marker.dxf

say "4. Take photos of it in clutter, through a wide-angle lens, and detect it in them"
python "$examples/take_photos.py" marker.json photos
markergen detect photos --marker marker.json --camera photos/camera.yaml --json found.json --overlay seen

say "5. Measure a print of it, made badly on purpose, by 20 photographs"
python "$examples/measure_print.py" marker.json print

say "Results, in $(pwd)"
cat <<'END'
  marker.pdf       the marker at true size: print at 100 % and check the rulers; marker.png, to look at
  marker.json      the marker itself: every point, its design spec, and its accuracy
  report.html      its expected accuracy and what limits it: open it in a browser
  validation.json  the same for programs: the errors of each estimator, and the bounds
  marker.step      a plate and its inlays as named, colored solids, in mm
  marker.3mf       the same in two materials for a 3-D printer's slicer
  marker.fab.pdf   the drawing for a workshop: dimensions, coordinates, tolerances
  marker.dxf       the face for a laser cutter: exact circles
  seen/            the annotated photos; found.json has the poses with their covariances
  print/           photographs of a bad print, measured.json with its dots as they are, and calibration.html
END
