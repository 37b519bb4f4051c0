#!/usr/bin/env python3
"""Makes shapes/ from public meshes in CARP text: a wall's surface as STL, a left ventricle as a label image. Needs numpy and nibabel.

    python make_shapes.py stl   ../meshes/arostica_lv/arostica_lv shapes/arostica-lv.stl
    python make_shapes.py image AMBIT_BIV/ambit_biv shapes/ambit-lv.nii.gz
"""

import sys
from pathlib import Path

import numpy as np

VOXEL_MM = 1.5
WALL_MM = 9.0  # tissue nearer than this to the left cavity is the left ventricle's, septum included


def points(stem):
    return np.loadtxt(f"{stem}.pts", skiprows=1) / 1000.0


def triangles(stem, name):
    return np.loadtxt(f"{stem}.{name}.surf", skiprows=1, usecols=(1, 2, 3), dtype=int)


def write_stl(stem, out):
    x = points(stem)
    names = sorted(file.name.split(".")[-2] for file in Path(stem).parent.glob(f"{Path(stem).name}.*.surf"))
    corners = x[np.vstack([triangles(stem, name) for name in names])].astype("<f4")
    record = np.zeros(len(corners), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    record["corners"] = corners
    Path(out).write_bytes(f"{Path(stem).name}, mm".encode().ljust(80) + np.uint32(len(corners)).tobytes() + record.tobytes())


def inside_tets(x, tets, grid):
    """Which points of a regular grid (origin, shape) lie in some tetrahedron."""
    origin, shape = grid
    found = np.zeros(shape, bool)
    for corners in x[tets]:
        low = np.maximum(np.floor((corners.min(0) - origin) / VOXEL_MM).astype(int), 0)
        high = np.minimum(np.ceil((corners.max(0) - origin) / VOXEL_MM).astype(int) + 1, shape)
        at = np.stack(np.meshgrid(*[np.arange(a, b) for a, b in zip(low, high)], indexing="ij"), -1)
        local = np.linalg.solve((corners[1:] - corners[0]).T, (origin + VOXEL_MM * at - corners[0]).reshape(-1, 3).T)
        within = (local.min(0) >= -1e-9) & (local.sum(0) <= 1 + 1e-9)
        found[tuple(at.reshape(-1, 3)[within].T)] = True
    return found


def write_image(stem, out):
    import nibabel
    from scipy.spatial import cKDTree

    x = points(stem)
    tets = np.loadtxt(f"{stem}.elem", skiprows=1, usecols=(1, 2, 3, 4), dtype=int)
    origin = x.min(0) - 3 * VOXEL_MM
    shape = tuple(np.ceil((np.ptp(x, axis=0) + 6 * VOXEL_MM) / VOXEL_MM).astype(int))
    tissue = inside_tets(x, tets, (origin, shape))
    at = np.argwhere(tissue)
    surface = {}
    for name in ("endo_lv", "endo_rv"):
        corners = x[triangles(stem, name)]
        weights = np.array([[a, b, 6 - a - b] for a in range(7) for b in range(7 - a)]) / 6
        surface[name] = cKDTree((corners[:, None, :, :] * weights[None, :, :, None]).sum(2).reshape(-1, 3))
    far = {name: tree.query(origin + VOXEL_MM * at)[0] for name, tree in surface.items()}
    labels = np.zeros(shape, np.uint8)
    labels[tuple(at.T)] = np.where(far["endo_lv"] < WALL_MM, 1, 2)
    image = nibabel.Nifti1Image(labels, np.diag([VOXEL_MM] * 3 + [1]) + np.pad(origin[:, None], ((0, 1), (3, 0))))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, out)


if __name__ == "__main__":
    kind, stem, out = sys.argv[1:4]
    {"stl": write_stl, "image": write_image}[kind](stem, out)
