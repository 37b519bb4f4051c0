#!/usr/bin/env python3
"""From a segmented image of a left ventricle to tetrahedra: a label image (NIfTI) or its surface (STL) in, a Medit mesh out.

The myocardium's surface is taken from the labels by marching cubes, and its inside filled by fTetWild, which keeps within a
distance of the surface and never fails on a rough one. `cardiotwin mesh repair` then cuts the base flat and names the surfaces.

    python mesh_from_image.py labels.nii.gz --myocardium 1 --edge-mm 4 --out heart.mesh
    python mesh_from_image.py wall.stl --edge-mm 4 --out heart.mesh
"""

import argparse
import contextlib
import struct
import sys
import tempfile
from pathlib import Path

import numpy as np


# Voxels of an image, and of its resampled form: a cube of a thousand each way. A packed header of a few bytes may claim any number.
MOST_VOXELS = 1_000_000_000

# Length of a unit of the image's header in mm; a header without a unit is in mm, as all viewers take it.
UNIT_MM = {"mm": 1.0, "meter": 1000.0, "micron": 0.001, "unknown": 1.0}


def refuse_large(path, shape, remedy):
    """Ends the program for an image of more voxels than any heart needs, before memory is taken for them."""
    n = 1
    for side in shape:
        n *= int(np.ceil(side))
    if n > MOST_VOXELS:
        sides = " x ".join(str(int(np.ceil(side))) for side in shape)
        sys.exit(f"{path}: an image of {sides} voxels, expected at most {MOST_VOXELS}; {remedy}")


def refuse_two_sizes(path, header):
    """Ends the program where the two maps of a header, sform and qform, have voxels of other sizes: one of them is wrong."""
    maps = [header.get_sform(coded=True)[0], header.get_qform(coded=True)[0]] if hasattr(header, "get_sform") else [None]
    if any(one is None for one in maps):
        return
    by_sform, by_qform = (np.sqrt((one[:3, :3] ** 2).sum(axis=0)) for one in maps)
    if not np.allclose(by_sform, by_qform, rtol=0.01):
        sizes = [" x ".join(f"{side:.3g}" for side in sides) for sides in (by_sform, by_qform)]
        sys.exit(f"{path}: voxels of {sizes[0]} by the header's sform and of {sizes[1]} by its qform, expected one size; write the right one again")


def labels_in_mm(path, frame=None):
    """Labels of an image as a 3D array, and its affine map to mm. `frame`: number of the image of a series, from 1."""
    import nibabel

    try:
        image = nibabel.load(path)
        refuse_large(path, image.shape, "save a part of it, or one frame")
        values = np.asarray(image.dataobj)
    except (OSError, EOFError, ValueError, nibabel.filebasedimages.ImageFileError) as error:
        sys.exit(f"{path}: cannot be read as an image ({error}); expected a NIfTI file, .nii or .nii.gz")
    try:
        unit = image.header.get_xyzt_units()[0] if hasattr(image.header, "get_xyzt_units") else "unknown"
    except KeyError as error:
        unit = f"the unknown unit {int(error.args[0])}"
    if unit not in UNIT_MM:
        sys.exit(f"{path}: lengths in {unit}, expected mm, metres or micrometres in the header")
    if values.dtype.kind not in "biuf":
        sys.exit(f"{path}: colours or other values that are no numbers, expected labels")
    refuse_two_sizes(path, image.header)
    affine = image.affine.copy()
    affine[:3] *= UNIT_MM[unit]
    if values.ndim < 3:
        sys.exit(f"{path}: an image of {values.ndim} dimensions, expected three")
    frames = values.reshape(values.shape[:3] + (-1,))
    n = frames.shape[3]
    if frame is None and n > 1:
        sys.exit(f"{path}: {n} frames; say which one with --frame, 1 to {n}")
    if not 1 <= (frame or 1) <= n:
        sys.exit(f"{path}: no frame {frame}; there are {n}")
    values = frames[..., (frame or 1) - 1]
    whole = np.isfinite(values) & (np.abs(values - np.rint(np.nan_to_num(values))) <= 1e-3)
    if not whole.all():
        sys.exit(f"{path}: values that are no whole numbers, such as {values[~whole][0]:g}; expected labels, not an image of grey values")
    sides_mm = np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    if not abs(np.linalg.det(affine[:3, :3])) > 1e-6 * sides_mm.prod():
        sys.exit(f"{path}: voxels without a volume, expected three independent axes; write the image's orientation (sform or qform) again")
    extent_mm = np.linalg.norm(sides_mm * values.shape)
    if not 20 <= extent_mm <= 3000:
        sys.exit(f"{path}: an image of {extent_mm:.3g} mm across, expected that of a heart; check the unit in its header ({unit})")
    return np.rint(values).astype(int), affine


def surface_of_labels(path, labels, voxel_mm, smooth_mm, frame=None):
    """Points (mm, the image's own world) and triangles of the boundary of some labels."""
    from scipy.ndimage import gaussian_filter, label as pieces, zoom
    from skimage.measure import marching_cubes

    values, affine = labels_in_mm(path, frame)
    inside = np.isin(values, labels)
    if not inside.any():
        sys.exit(f"{path}: no voxel has one of the labels {labels}; labels there are {np.unique(values).tolist()}")
    # islands that the segmentation left: the largest piece is the heart
    numbered, n = pieces(inside)
    if n > 1:
        sizes = np.bincount(numbered.ravel())[1:]
        print(f"{n - 1} islands of {sizes.sum() - sizes.max()} voxels left out", file=sys.stderr)
        inside = numbered == 1 + sizes.argmax()
    sides_mm = np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    inside = np.pad(inside.astype(np.float32), 2)
    # thick slices are resampled before they are smoothed, so that steps between them do not become ridges
    factors = np.maximum(sides_mm / voxel_mm, 1.0)
    refuse_large(path, np.array(inside.shape) * factors, "give a larger --voxel-mm, or a part of the image")
    fine = zoom(inside, factors, order=1, grid_mode=True, mode="nearest")
    fine = gaussian_filter(fine, smooth_mm / (sides_mm / factors))
    points, triangles, _, _ = marching_cubes(fine, 0.5)
    voxels = (points + 0.5) / factors - 0.5 - 2
    return voxels @ affine[:3, :3].T + affine[:3, 3], triangles


def surface_of_stl(path, unit_mm):
    """Points (mm) and triangles of an STL file, text or binary; equal corners are merged."""
    data = Path(path).read_bytes()
    n = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * n:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(data, record, n, 84)["corners"].reshape(-1, 3)
    else:
        rows = [line.split()[1:4] for line in data.decode().splitlines() if line.strip().startswith("vertex")]
        corners = np.array(rows, float)
    points, index = np.unique(np.round(corners.astype(float) * unit_mm, 4), axis=0, return_inverse=True)
    return points, index.reshape(-1, 3)


def tetrahedra(points, triangles, edge_mm, distance_mm):
    """fTetWild: edges of about `edge_mm`, the surface within `distance_mm`."""
    import pytetwild

    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    # fTetWild leaves a file of its own where it runs
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        nodes, tets = pytetwild.tetrahedralize(
            np.ascontiguousarray(points, float),
            np.ascontiguousarray(triangles, np.int32),
            edge_length_fac=edge_mm / diagonal,
            epsilon=distance_mm / diagonal,
            quiet=True,
        )[:2]
    return np.asarray(nodes), np.asarray(tets)


def write_medit(path, nodes, tets, tag):
    with open(path, "w", encoding="ascii") as out:
        out.write(f"MeshVersionFormatted 2\nDimension 3\nVertices\n{len(nodes)}\n")
        np.savetxt(out, np.c_[nodes, np.zeros(len(nodes))], fmt="%.9g %.9g %.9g %d")
        out.write(f"Tetrahedra\n{len(tets)}\n")
        np.savetxt(out, np.c_[tets + 1, np.full(len(tets), tag)], fmt="%d")
        out.write("End\n")


def main():
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("input", type=Path, help="label image (.nii, .nii.gz) or surface of the wall (.stl)")
    ask.add_argument("--myocardium", default="1", help="labels of the left ventricle's wall, separated by commas")
    ask.add_argument("--frame", type=int, help="number of the image in a series of several, from 1")
    ask.add_argument("--unit-mm", type=float, default=1.0, help="length of an STL file's unit in mm")
    ask.add_argument("--edge-mm", type=float, default=4.0, help="length of edges")
    ask.add_argument("--voxel-mm", type=float, default=1.0, help="labels are resampled to at most this size")
    ask.add_argument("--smooth-mm", type=float, default=1.0, help="standard deviation of the labels' smoothing")
    ask.add_argument("--distance-mm", type=float, default=0.3, help="how far the mesh may be from the surface")
    ask.add_argument("--out", type=Path, required=True, help="Medit file in mm")
    args = ask.parse_args()
    if args.input.suffix == ".stl":
        points, triangles = surface_of_stl(args.input, args.unit_mm)
    else:
        try:
            labels = [int(label) for label in args.myocardium.split(",")]
        except ValueError:
            sys.exit(f"--myocardium {args.myocardium}: expected whole numbers, separated by commas")
        points, triangles = surface_of_labels(args.input, labels, args.voxel_mm, args.smooth_mm, args.frame)
    print(f"surface: {len(points)} points, {len(triangles)} triangles", file=sys.stderr)
    nodes, tets = tetrahedra(points, triangles, args.edge_mm, args.distance_mm)
    write_medit(args.out, nodes, tets, 1)
    print(f"{args.out}: {len(nodes)} nodes, {len(tets)} tetrahedra, in mm", file=sys.stderr)


if __name__ == "__main__":
    main()
