#!/usr/bin/env bash
# From a machine of which nothing is known to a program that is corrected for it: photograph, calibrate, measure,
# find the 21 errors, correct, prove. A virtual machine stands in for yours; with a real one, leave `simulate` out.
#
#     examples/pictures_to_program.sh [FOLDER]
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
folder="${1:-$(mktemp -d)}"
mkdir -p "$folder"
cd "$folder"

echo "== photograph: 12 pairs of pictures of the plates, 5 of the board"
geoerr simulate "$here/nine_lines.toml" -o session --quiet
echo "== calibrate both cameras"
geoerr calibrate session -o rig.json --quiet | tail -8
echo "== measure: pictures to points, each with its covariance"
geoerr measure session --rig rig.json -o observations.csv --quiet | sed -n 1,1p
echo "== find the 21 errors"
geoerr identify observations.csv --machine session/machine.toml --rig rig.json -o errors.json --quiet | sed -n 1,24p

cp "$here/part.gcode" .
echo "== correct a program"
geoerr compensate errors.json part.gcode -o part-corrected.gcode --quiet
echo "== prove it: on the model, and on the true machine that nobody else knows"
geoerr verify path errors.json part.gcode part-corrected.gcode --quiet
geoerr verify path session/truth.json part.gcode part-corrected.gcode --keep-uncertain --quiet
echo "everything is in $folder"
