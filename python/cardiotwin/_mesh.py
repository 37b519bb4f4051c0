"""`heart.json` for PyVista."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyvista


def heart(file: Path) -> pyvista.MultiBlock:
    """A block for each state, with `Sa_kPa` and `lambda` at the corners and the part of each triangle."""
    surface = json.loads(file.read_text(encoding="utf-8"))
    triangles = np.concatenate([np.asarray(part["triangles"], dtype=np.int64) for part in surface["parts"]])
    faces = np.hstack([np.full((len(triangles), 1), 3, dtype=np.int64), triangles]).ravel()
    names = [part["surface"] for part in surface["parts"] for _ in part["triangles"]]
    blocks = pyvista.MultiBlock()
    for state in surface["states"]:
        block = pyvista.PolyData(np.asarray(state["points_mm"], dtype=np.float64), faces)
        for key in ("Sa_kPa", "lambda"):
            block.point_data[key] = np.asarray(state[key], dtype=np.float64)
        block.cell_data["surface"] = names
        for key in ("time_ms", "volume_mL", "pressure_mmHg"):
            block.field_data[key] = [state[key]]
        blocks.append(block, state["name"])
    return blocks
