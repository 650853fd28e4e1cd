#!/usr/bin/env bash
# A folder of programs corrected in one go: each beside its original, one line each, and what cannot be corrected named.
#
#     examples/folder_of_programs.sh [FOLDER]
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
folder="${1:-$(mktemp -d)}"
python "$here/virtual_machines.py" warm-mill "$folder"
cd "$folder"
geoerr fit observations.csv --machine machine.toml --components 12 --add backlash:x -o model.json --quiet > fit.txt

mkdir -p programs corrected
printf 'G21\nG90\nG0 X50 Y50 Z20\nG1 X350 Y50 F1200\nG1 X350 Y350\n' > programs/corner.gcode
printf 'G21\nG90\nG0 X50 Y50 Z20\nG1 X450 F1200\n' > programs/too-far.gcode
printf 'G20\nG90\nG0 X2 Y2 Z1\nG1 X12 F40\nG1 Y12\n' > programs/inches.ngc
printf 'G21\nG90\nG0 X50 Y50 Z20\nG81 X60 Y60 Z5 R10 F200\n' > programs/drilling.ngc

echo "program              before, µm   after, µm"
for program in programs/*; do
    name="$(basename "$program")"
    if ! geoerr compensate model.json "$program" -o "corrected/$name" --quiet > said.txt 2> why.txt; then
        printf '%-18s   refused: %s\n' "$name" "$(sed -n 1p why.txt | sed 's/^error: //')"
        continue
    fi
    geoerr verify path model.json "$program" "corrected/$name" --quiet \
        | awk -v name="$name" '/^largest error/ { printf "%-18s%13.1f%12.1f\n", name, $4, $5 }'
done
echo "corrected programs are in $folder/corrected"
