#!/usr/bin/env bash
# Installs FEniCSx for lv.py on Debian 13 (or another system whose python3-dolfinx is 0.9 or newer), as root: Debian's dolfinx, and
# fenicsx-pulse, cardiac-geometries-core and Gmsh from PyPI in a virtual environment. Usage: install.sh FOLDER
#   FOLDER  of the virtual environment
# Debian's own Gmsh lacks Netgen, which cardiac-geometries asks for; its libraries of windows are what PyPI's Gmsh is linked to.
set -euo pipefail
folder=${1:?usage: install.sh FOLDER}
export DEBIAN_FRONTEND=noninteractive
apt-get update -q
apt-get install -q -y --no-install-recommends ca-certificates python3-dolfinx python3-scipy python3-venv python3-dev g++ cmake \
    libgl1 libglu1-mesa libxcursor1 libxfixes3 libxft2 libxinerama1 libxrender1 libgomp1
python3 -m venv --system-site-packages "$folder"
"$folder/bin/pip" install --quiet fenicsx-pulse==0.12.0 cardiac-geometries-core==1.5.0 gmsh==4.15.2
"$folder/bin/python" -c 'import cardiac_geometries_core, dolfinx, gmsh, pulse; print("dolfinx", dolfinx.__version__, "is ready")'
