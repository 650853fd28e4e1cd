#!/usr/bin/env bash
# G-code verified: a corrected program is followed by a reader of its own and compared with what was meant, and a
# program that somebody touched afterwards is caught.
#
#     examples/program_verified.sh [FOLDER]
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
folder="${1:-$(mktemp -d)}"
python "$here/virtual_machines.py" warm-mill "$folder"
cd "$folder"
geoerr fit observations.csv --machine machine.toml --components 12 \
    --add thermal-expansion:y@temp_bed -o model.json --quiet > fit.txt

cat > frame.ngc <<'GCODE'
(a frame, cut in two depths)
G21 G90
G0 X20 Y60 Z60
G1 Z50 F300
G1 Y380 F1200
G1 X380
G1 Y60
G1 X20
G1 Z45 F300
G1 Y380 F1200
G1 X380
G1 Y60
G1 X20
M2
GCODE
echo "== corrected for a bed of 40 °C; no point further than 5 µm from where it was meant"
geoerr compensate model.json frame.ngc -o frame-40.ngc --at temp_bed=40 --tolerance 0.005 --quiet
geoerr verify path model.json frame.ngc frame-40.ngc --at temp_bed=40 --tolerance 0.005 --quiet

echo "== the same program, its last corner moved by 0.05 mm"
tac frame-40.ngc | sed '0,/^G1 X/s/^G1 X\([0-9.]*\)/G1 X20.05/' | tac > touched.ngc
diff frame-40.ngc touched.ngc || true
if geoerr verify path model.json frame.ngc touched.ngc --at temp_bed=40 --tolerance 0.005 --quiet; then
    echo "nobody noticed" >&2
    exit 1
fi
echo "exit status 1: it is not let through"
