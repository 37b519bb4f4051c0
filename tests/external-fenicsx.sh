#!/usr/bin/env bash
# Personalises a patient with FEniCSx, a 3D solver that is not ours (examples/external-fenicsx), and checks that solver on the
# ventricles of Land et al. 2015. Usage: tests/external-fenicsx.sh TARGET [FOLDER]
#   TARGET  cargo's target folder, with the programs of a release build; the run is kept in TARGET/external-fenicsx
#   FOLDER  a bare Debian 13 with FEniCSx in /opt/fenicsx [default: TARGET/debian-fenicsx]; made where it is not there
# `tests/external-fenicsx.sh --can` says whether this machine can, and why not.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "${1:-}" = --can ]; then
    [ "$(id -u)" = 0 ] || { echo "a chroot needs root"; exit 1; }
    command -v debootstrap >/dev/null || { echo "debootstrap is not installed"; exit 1; }
    exit 0
fi
target=$(cd "${1:?usage: $0 TARGET [FOLDER]}" && pwd)
debian=${2:-$target/debian-fenicsx}
kept=$target/external-fenicsx

mkdir -p "$debian"
debian=$(cd "$debian" && pwd)
if [ ! -e "$debian/etc/debian_version" ]; then
    debootstrap --variant=minbase --include=ca-certificates trixie "$debian" "${MIRROR:-http://deb.debian.org/debian}"
fi
cp /etc/resolv.conf "$debian/etc/resolv.conf"
cp /etc/ssl/certs/ca-certificates.crt "$debian/etc/ssl/certs/ca-certificates.crt"
mounted=()
leave() { for place in "${mounted[@]}"; do umount --lazy "$place"; done; }
trap leave EXIT
put() { mount "${@:1:$#-1}" "$debian${!#}"; mounted=("$debian${!#}" "${mounted[@]}"); }
put -t proc proc /proc
put -t sysfs sys /sys
put --bind /dev /dev
there() { # command in the Debian, with FEniCSx's Python before its own
    chroot "$debian" /usr/bin/env -i HOME=/root LANG=C.UTF-8 PATH=/opt/fenicsx/bin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"
}

rm -rf "$debian/root/cardiotwin" "$kept"
mkdir -p "$debian/root/cardiotwin" "$kept"
cp -r examples/coa-seven examples/external-fenicsx "$debian/root/cardiotwin/"
cp "$target"/release/cardiotwin{,-worker} "$debian/usr/local/bin/"
there python -c 'import cardiac_geometries_core, dolfinx, gmsh, pulse' 2>/dev/null ||
    there bash /root/cardiotwin/external-fenicsx/install.sh /opt/fenicsx

there python /root/cardiotwin/external-fenicsx/check.py

there cardiotwin run /root/cardiotwin/external-fenicsx --patient 01-CoA --run-dir /root/cardiotwin/run --set executor.workers=1
there cardiotwin show 01-CoA --run-dir /root/cardiotwin/run --json >"$kept/01-CoA.json"
cp -r "$debian/root/cardiotwin/run/report.html" "$kept/"
there python - <<'END'
import json
import subprocess

said = subprocess.run(["cardiotwin", "show", "01-CoA", "--run-dir", "/root/cardiotwin/run", "--json"], capture_output=True, text=True, check=True)
patient = json.loads(said.stdout)
steps = patient["iterations"], patient["step3_iterations"]
print([beat["proposal"]["result"]["law_beats"] for step in steps for beat in step], patient["verdict"])
assert patient["verdict"]["personalised"], patient["verdict"]
assert patient["step1"]["quality"]["quality"] == "converged", patient["step1"]
# Each beat taught the law in which the next one was sought.
assert [beat["proposal"]["result"]["law_beats"] for beat in steps[0]] == list(range(len(steps[0])))
n_beats = len(steps[0]) + 1 + len(steps[1])
assert n_beats <= 6, f"{n_beats} beats"
law = [beat["proposal"]["result"]["learned_law"] for step in steps for beat in step][-1]
worst = max(beat["after"]["rms_mmHg"] for beat in law["beats"])
assert worst < 2.0, f"the law is off its beats by {worst} mmHg"
print(f"personalised with {n_beats} beats of FEniCSx; law within {worst:.2f} mmHg (rms) of each")
END
echo "FEniCSx personalises a patient"
