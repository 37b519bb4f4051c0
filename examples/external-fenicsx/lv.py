#!/usr/bin/env python3
"""A left ventricle in FEniCSx (dolfinx, fenicsx-pulse, cardiac-geometries) for cardiotwin.

    lv.py parameters.json OUT [SIZE]

Reads what cardiotwin hands over (docs/external-solvers.md), simulates the beats and writes OUT/traces.csv and OUT/nodal.csv.
SIZE is the edge of an element over the wall's thickness (1.6: some 1,400 elements; 1.0: 2,900).
Exit codes: 0 done, 2 parameters that make no sense here, 3 the simulation diverged, 4 a Python package is missing.
"""
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: threads cost more than they gain
try:
    import numpy as np
    from cells import model_of
    from wall import VISCOSITY, Diverged, Wall, depths, fibres, generated
except ImportError as missing:
    print(f"{missing}: README.md says how to install it", file=sys.stderr)
    sys.exit(4)

STEPS_MS = (2.0, 6.0)  # shortest and longest time step
STEP_MMHG, STEP_ML = 5.0, 2.5  # that a step should change
SHORTEST_MS = 0.25  # after halving where no equilibrium is found


def onsets(given, wall, axes):
    """Activation times of the points in ms: from apex to base and from inside out, spread as in cardiotwin's one-fibre ventricle."""
    height = (wall.middles[:, 0] + axes[3]) / (axes[4] + axes[3])
    order = np.argsort(height + depths(wall.middles, axes))
    share = np.empty(order.size)
    volumes = wall.cell_volumes[order]
    share[order] = (np.cumsum(volumes) - 0.5 * volumes) / volumes.sum()
    late = np.linspace(0, 1, 1001)  # 6 x (1 - x) of the wall at x of the spread
    of_cells = np.interp(share, 3 * late**2 - 2 * late**3, late)
    activation = given["activation"]
    return activation["onset_ms"] + activation["spread_ms"] * of_cells


class Circulation:
    """Valves, a constant left atrium and the three-element Windkessel, implicit in the flow."""

    def __init__(self, given):
        load, self.valves = given["circulation"], given["valves"]
        for key in ("closed", "effects"):
            if load.get(key):
                raise ValueError(f"circulation.{key} is set, but this solver has the open circuit alone")
        self.atrium = load["left_atrial_pressure_mmHg"]
        after = load["afterload"]
        self.r1 = after["characteristic_resistance_mmHg_s_per_mL"]
        self.r2 = after["peripheral_resistance_mmHg_s_per_mL"]
        self.c = after["compliance_mL_per_mmHg"]
        self.stored = load["initial_windkessel_pressure_mmHg"]

    def flows(self, pressure, dt):
        """Into and out of the ventricle in mL/s at the end of a step, and the Windkessel's pressure there."""
        valves = self.valves
        back = valves["R_b_mmHg_s_per_mL"]
        into = (self.atrium - pressure) / (valves["R_MV_f_mmHg_s_per_mL"] if self.atrium > pressure else back)
        share = 1e-3 * dt / self.c
        kept, gain = self.stored / (1 + share / self.r2), share / (1 + share / self.r2)
        drop = pressure - kept
        out = drop / ((valves["R_AV_f_mmHg_s_per_mL"] if drop > 0 else back) + self.r1 + gain)
        return into, out, kept + gain * out


class Beats:
    def __init__(self, given, folder, size):
        start = given["start"]
        self.given, self.cycle = given, given["cycle_length_ms"]
        self.circulation = Circulation(given)
        begun = time.monotonic()
        heart, axes = generated(start["unloaded_volume_mL"], start["wall_volume_mL"], size)
        self.wall = wall = Wall(heart, fibres(heart.mesh, axes))
        self.onset = onsets(given, wall, axes)
        n_points = wall.points.shape[1]
        self.model = model_of(given, folder, np.repeat(self.onset, n_points))
        wall.inflate(start["end_diastolic_volume_mL"], start["end_diastolic_pressure_mmHg"])
        print(
            f"{wall.cells.size} elements; C = {float(wall.stiffness.value) / 1e3:.3f} kPa holds "
            f"{wall.volume_ml():.2f} mL at {wall.pressure_mmhg():.2f} mmHg; {time.monotonic() - begun:.0f} s",
            flush=True,
        )

    def step(self, t, dt):
        """One step to time t, halved where no equilibrium is found."""
        wall, circulation = self.wall, self.circulation
        kept = wall.w.x.array.copy(), float(wall.pressure.value)
        wall.before.x.array[:], wall.viscosity.value = kept[0], VISCOSITY / dt
        volume, before, state, limit = self.volume, self.stretch, self.state, 1e-5

        def cells(stretch):
            stress, _, _ = self.model.step(state, stretch, before, t, dt)
            more, _, _ = self.model.step(state, stretch + limit, before, t, dt)
            return stress, (more - stress) / limit

        def left(pressure):
            into, out, _ = circulation.flows(pressure, dt)
            return volume + 1e-3 * dt * (into - out)

        if self.rate is not None:  # a guess along the last step
            wall.w.x.array[:] += dt * self.rate[0]
            wall.pressure.value = float(wall.pressure.value) + dt * self.rate[1]
        try:
            wall.equilibrium(cells, left)
        except Diverged:
            wall.w.x.array[:], wall.pressure.value, wall.factored = kept[0], kept[1], False
            if self.rate is not None:
                self.rate = None
                return self.step(t, dt)
            if dt < 2 * SHORTEST_MS:
                raise
            self.step(t - 0.5 * dt, 0.5 * dt)
            return self.step(t, 0.5 * dt)
        self.rate = (wall.w.x.array - kept[0]) / dt, (float(wall.pressure.value) - kept[1]) / dt
        self.stretch = wall.stretches()
        self.stress, self.state, self.calcium = self.model.step(state, self.stretch, before, t, dt)
        self.volume = wall.volume_ml()
        into, out, circulation.stored = circulation.flows(wall.pressure_mmhg(), dt)
        return self.row(t, into, out)

    def row(self, t, into=0.0, out=0.0):
        wall = self.wall
        aorta = self.circulation.stored + self.circulation.r1 * out
        means = [wall.mean(values) for values in (self.stress, self.calcium, self.stretch)]
        return [t, wall.pressure_mmhg(), self.volume, aorta, out, into], means

    def run(self):
        wall = self.wall
        self.volume, self.stretch, self.state = wall.volume_ml(), wall.stretches(), self.model.begin()
        self.stress = self.calcium = np.zeros_like(self.stretch)
        rows = []
        for beat in range(self.given["beats"]):
            begun, self.rate, t, dt, said = time.monotonic(), None, 0.0, STEPS_MS[0], 0.0
            rows = [self.row(0.0)]
            while t < self.cycle - 1e-6:
                dt = min(dt, self.cycle - t)
                t += dt
                rows.append(self.step(t, dt))
                (_, p0, v0, *_), (_, p1, v1, *_) = rows[-2][0], rows[-1][0]
                changed = max(abs(p1 - p0) / STEP_MMHG, abs(v1 - v0) / STEP_ML, 1e-3)
                dt = float(np.clip(dt / changed, max(0.5 * dt, STEPS_MS[0]), STEPS_MS[1]))
                if t - said >= 50 or t >= self.cycle - 1e-6:
                    said = t
                    print(
                        f"beat {beat + 1}: {t:.0f} of {self.cycle:.0f} ms, {p1:.1f} mmHg, {v1:.1f} mL; {len(rows) - 1} steps, "
                        f"{wall.n_iterations} iterations, {wall.n_factors} factors, {time.monotonic() - begun:.0f} s",
                        flush=True,
                    )
        return rows


def write(folder, beats, rows):
    head = "time_ms,pressure_mmHg,volume_mL,aortic_pressure_mmHg,aortic_flow_mL_per_s,mitral_flow_mL_per_s"
    text = lambda values: ",".join(f"{value:.7g}" for value in values)
    (folder / "traces.csv").write_text("\n".join([head, *(text(row) for row, _ in rows), ""]))
    # A node of cardiotwin's is an element here, weighted by its volume.
    kinds = [("Sa_kPa", 0), *([("Ca_uM", 1)] if beats.model.has_calcium else []), ("lambda", 2)]
    n = beats.wall.cells.size
    names = ",".join(["time_ms", *(f"{name}[{k + 1}]" for name, _ in kinds for k in range(n))])
    weights = beats.wall.cell_volumes / beats.wall.cell_volumes.sum()
    lines = [f"# activation_ms: {text(beats.onset)}", f"# weight: {text(weights)}", names]
    lines += [text(np.concatenate([[row[0]], *(means[k] for _, k in kinds)])) for row, means in rows]
    (folder / "nodal.csv").write_text("\n".join([*lines, ""]))


def main():
    if len(sys.argv) not in (3, 4):
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    folder = Path(sys.argv[2])
    given = json.loads(Path(sys.argv[1]).read_text())
    try:
        beats = Beats(given, folder, float(sys.argv[3]) if len(sys.argv) > 3 else 1.6)
        rows = beats.run()
    except ValueError as error:
        print(f"{sys.argv[1]}: {error}", file=sys.stderr)
        sys.exit(2)
    except Diverged as error:
        print(f"diverged: {error}", file=sys.stderr)
        sys.exit(3)
    write(folder, beats, rows)


if __name__ == "__main__":
    main()
