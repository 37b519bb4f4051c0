"""Work and precision of the cell engine beside SciPy's LSODA and Radau, measured in one run on one machine.

Every solver does the same: from the static equilibrium to the periodic beat, and that beat on a 1 ms grid, for the 31 stored
sets (tests/data/cell0d.json). Error: largest difference of the active stress to the stored beat (SciPy's Radau, rtol 1e-10).
Time: processor time of one thread a cell. SciPy's solvers run with the right-hand side compiled by numba, LSODA in Python, too.

    make work-precision

writes docs/images/work-precision.svg and docs/images/work-precision.csv.
"""

import csv
import json
import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
from scipy.integrate import odeint, solve_ivp

import cell

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
IMAGES = ROOT / "docs/images"
COLUMNS = ["solver", "right_hand_side", "tolerance", "us_per_cell", "steps_per_beat", "beats", "error_median_kPa", "error_largest_kPa"]
MOST_BEATS = 30


def engine_rows():
    """What `cargo bench --bench work_precision -- --csv` prints."""
    command = "cargo bench --locked --manifest-path dev/Cargo.toml --bench work_precision -- --csv".split()
    text = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def last_beat(solve, y0, cycle_ms, tolerance):
    """Beats until the state returns to ten times the tolerance, then one more on the grid; and the number of beats."""
    grid = np.arange(0.0, cycle_ms + 0.5, 1.0)
    ends, y = np.array([0.0, cycle_ms]), y0
    for n in range(1, MOST_BEATS):
        new = solve(ends, y)[-1]
        change, y = np.max(np.abs(new - y)), new
        if change <= 10 * tolerance:
            break
    return solve(grid, y), n + 1


def with_odeint(rhs, c, tolerance):
    def solve(times, y):
        return odeint(rhs, y, times, args=(c,), tfirst=True, rtol=tolerance, atol=1e-3 * tolerance, mxstep=100_000)

    return solve


def with_radau(rhs, c, tolerance):
    def solve(times, y):
        answer = solve_ivp(rhs, times[[0, -1]], y, method="Radau", t_eval=times, args=(c,), rtol=tolerance, atol=1e-3 * tolerance)
        return answer.y.T

    return solve


METHODS = {"LSODA": (with_odeint, [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9]), "Radau": (with_radau, [1e-2, 1e-3, 1e-4, 1e-5, 1e-6])}


def scipy_rows(sets):
    rows = []
    for compiled in (True, False):
        rhs, stress_and_stretch, rest = cell.right_hand_side(compiled)
        for method, (make, tolerances) in METHODS.items():
            # Time alone differs: two tolerances of the faster solver place the curve of the slow right-hand side.
            if not compiled:
                tolerances = tolerances[1:6:4] if method == "LSODA" else []
            for tolerance in tolerances:
                seconds, errors, beats = [], [], []
                for entry in sets:
                    c = cell.constants(entry["parameters"], entry["lambda_0"])
                    solve = make(rhs, c, tolerance)
                    if compiled and not seconds:
                        last_beat(solve, rest(c), 20.0, tolerance)
                    times = []
                    for _ in range(3 if compiled and method == "LSODA" else 1):
                        start = time.thread_time()
                        beat, n_beats = last_beat(solve, rest(c), entry["cycle_length_ms"], tolerance)
                        times.append(time.thread_time() - start)
                    sa = [stress_and_stretch(y, c)[0] for y in beat]
                    errors.append(np.max(np.abs(np.array(sa) - entry["Sa_kPa"])))
                    seconds.append(min(times))
                    beats.append(n_beats)
                kind = "compiled" if compiled else "Python"
                row = [f"SciPy {method}", kind, f"{tolerance:.0e}", f"{1e6 * statistics.mean(seconds):.1f}", "", f"{statistics.mean(beats):.2f}"]
                rows.append(dict(zip(COLUMNS, row + [f"{statistics.median(errors):.1e}", f"{max(errors):.1e}"])))
                print(", ".join(rows[-1].values()), file=sys.stderr, flush=True)
    return rows


def check(sets):
    """The Python cell is the stored one: LSODA at a fine tolerance reproduces the stored beats."""
    rhs, stress_and_stretch, rest = cell.right_hand_side(True)
    for entry in sets:
        c = cell.constants(entry["parameters"], entry["lambda_0"])
        beat, _ = last_beat(with_odeint(rhs, c, 1e-9), rest(c), entry["cycle_length_ms"], 1e-9)
        error = max(abs(stress_and_stretch(y, c)[0] - sa) for y, sa in zip(beat, entry["Sa_kPa"]))
        if error > 1e-5:
            sys.exit(f"{entry['name']}: {error:.1e} kPa from the stored beat")


def processor():
    names = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    return names[0] if names else platform.processor()


def draw(rows, file):
    """Error against time, and the engine's error against its steps a beat."""
    plt.rcParams.update({"svg.hashsalt": "work-precision", "svg.fonttype": "none", "font.size": 9, "axes.grid": True, "grid.color": "#e4e8ec"})
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.2, 4.0), width_ratios=[3, 2], layout="constrained")
    looks = {"cell engine": ("#d55e00", "o"), "SciPy LSODA": ("#0072b2", "s"), "SciPy Radau": ("#009e73", "^")}
    curves = {}
    for row in rows:
        curves.setdefault((row["solver"], row["right_hand_side"]), []).append(row)
    for (solver, kind), curve in curves.items():
        colour, marker = looks[solver]
        times, errors = [float(r["us_per_cell"]) for r in curve], [float(r["error_median_kPa"]) for r in curve]
        line = ":" if kind == "Python" else "-"
        name = solver if solver == "cell engine" else f"{solver}, {kind} right-hand side"
        left.loglog(times, errors, line, color=colour, marker=marker, markersize=4, label=name)
    left.set(xlabel="processor time a cell, periodic state included (µs)", ylabel="error of the active stress, median (kPa)")
    left.legend(frameon=False, fontsize=8)
    engine = curves["cell engine", "compiled"]
    steps, errors = np.array([[float(r["steps_per_beat"]), float(r["error_median_kPa"])] for r in engine]).T
    right.loglog(steps, errors, "-o", color="#d55e00", markersize=4, label="cell engine")
    right.loglog(steps, errors[-1] * (steps / steps[-1]) ** -4.0, "--", color="#5d6873", label="order 4")
    right.set(xlabel="steps a beat")
    right.set_xticks([50, 100, 200, 400], ["50", "100", "200", "400"])
    right.minorticks_off()
    right.legend(frameon=False, fontsize=8)
    figure.savefig(file, metadata={"Date": None})


def main():
    sets = json.loads((ROOT / "solver/cell-engine/tests/data/cell0d.json").read_text())["sets"]
    check(sets)
    rows = engine_rows() + scipy_rows(sets)
    IMAGES.mkdir(exist_ok=True)
    with open(IMAGES / "work-precision.csv", "w", newline="") as file:
        file.write(f"# processor: {processor()}\n")
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, IMAGES / "work-precision.svg")


if __name__ == "__main__":
    main()
