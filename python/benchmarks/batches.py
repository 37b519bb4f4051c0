"""Batches from NumPy beside the loops of Rust, on one thread.

Usage: python python/benchmarks/batches.py [PATH OF cardiotwin-dev]

Rust: `cardiotwin-dev bench beat` (a beat of Land's and Rice's cell in the average ventricle at 2 ms steps) and
`bench cell` (1,024 cells within step 2's bounds). Python: the same beat as 10,000 rows, and 100,000 cells within these
bounds, once as batches of 1,024 (their median) and once as a whole. A few of 100,000 cells have no periodic beat, and
take a thousand times as long.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import cardiotwin
import numpy as np

DEV = sys.argv[1] if len(sys.argv) > 1 else "target/release/cardiotwin-dev"
ROUNDS = 7


def rust(kind: str, key: str) -> float:
    answer = subprocess.run([DEV, "bench", kind, "--json"], capture_output=True, text=True, check=True).stdout
    return float(json.loads(answer)[key])


def seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def row(name: str, of_rust: list[float], of_python: list[float], unit: str) -> None:
    ours, theirs = statistics.median(of_python), statistics.median(of_rust)
    print(f"{name:32} {theirs:10.3f} {ours:10.3f} {unit:4} {100 * (ours / theirs - 1):+7.1f} %")


specification = cardiotwin.Ventricle.average().with_cell({"Ca50_ref_uM": 0.5}, lambda_0=1.1).specification
specification["time_step_ms"] = 2.0
ventricle = cardiotwin.Ventricle(specification)
stress = np.full((10_000, 1), 200.0)

settings = json.loads(cardiotwin.call("config", "show", "examples/coa-seven", "--json"))
prefix = "step2.bounds."
bounds = {s["key"].removeprefix(prefix): s["value"] for s in settings if s["key"].startswith(prefix)}
lower, upper = np.array(list(bounds.values())).T
cells = np.random.default_rng(1).uniform(lower, upper, size=(100_000, len(bounds)))


def evaluate(cells: np.ndarray) -> float:
    """Microseconds for each cell."""
    batch = lambda: cardiotwin.cell_beats(  # noqa: E731
        cells, list(bounds), cycle_length_ms=800, lambda_0=1.0, negative_kwu="refuse", threads=1
    )
    return 1e6 * seconds(batch) / len(cells)


rust_beat, python_beat, rust_cell, python_cell, python_whole = [], [], [], [], []
for _ in range(ROUNDS):  # in turn, so that both meet the same load
    rust_beat.append(rust("beat", "ms_per_beat_of_a_cell"))
    python_beat.append(1e3 * seconds(lambda: ventricle.beats(stress, ["Smax_ref_kPa"], threads=1)) / len(stress))
    rust_cell.append(rust("cell", "us_per_evaluation"))
    blocks = [cells[start : start + 1024] for start in range(0, len(cells) - 1023, 1024)]
    python_cell.append(statistics.median(evaluate(block) for block in blocks))
    python_whole.append(evaluate(cells))
print(f"{'':32} {'Rust':>10} {'Python':>10}")
row("reduced beat of a cell, of 10,000", rust_beat, python_beat, "ms")
row("cell, batches of 1,024", rust_cell, python_cell, "µs")
row("cell, 100,000 at once", rust_cell, python_whole, "µs")
