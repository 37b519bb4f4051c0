#!/bin/bash
# Shows what cardiotwin does, the quickest first: a Windkessel fitted to a measured aorta, an effect that a model lacks, the twins of a cohort.
# Usage: demo.sh PROGRAMS COHORT FOLDER
#   PROGRAMS: folder of the programs; COHORT: folder of the cohort; FOLDER: for the first plot
set -euo pipefail
cd "$(dirname "$0")/.."
cardiotwin=$1/cardiotwin cohort=$2 folder=$3
mkdir -p "$folder"

record=examples/afterload/human-1999
echo "== the afterload of a measured aorta ($folder/afterload.svg)"
"$cardiotwin" fit afterload $record/flow.csv $record/pressure.csv --plot "$folder/afterload.svg"

echo; echo "== an effect that the model lacks in examples/hidden-effect"
# Kept next to the cohort, so that the cohort's report shows it.
"$cardiotwin" discover examples/hidden-effect --run-dir "$cohort/discover" --json "$folder/hidden-effect.json"
effect=$(grep -A 1 '"accepted": \[' "$folder/hidden-effect.json" | sed -n '2s/[ ",]//gp')

echo; echo "== the twins of $cohort"
open=()
[ -z "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ] || open=(--open)
code=0
"$cardiotwin" run "$cohort" "${open[@]}" || code=$?
[ $code = 0 ] || [ $code = 7 ] || exit $code # 7: a twin is off

status=$("$cardiotwin" status "$cohort" --json)
n=$(grep -c '"note":' <<< "$status")
good=$(grep -cE '"note": "(.*; )?personalised' <<< "$status") || true
echo
echo "done: found the hidden effect (${effect:-none}), and fitted twins to the $n patients of $cohort"
echo "how good: the beat of $good of $n twins is within the tolerances of its measurements"
echo "open: $cohort/run/report.html, and $cohort/discover/report.html for the effect"
