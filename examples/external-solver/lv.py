#!/usr/bin/env python3
"""A left ventricle that is not cardiotwin's: an example of an external solver. Python 3.8 or newer, no packages.

    lv.py parameters.json OUT [--igb]

Reads what cardiotwin hands over (docs/external-solvers.md), simulates the beats and writes OUT/traces.csv and OUT/nodal.csv;
with --igb active stress, stretch and calcium as openCARP's .igb files and activation times as lat.dat, in place of nodal.csv.
Exit codes: 0 done, 2 parameters that make no sense, 3 the simulation diverged.

The ventricle is a thick-walled sphere whose fibres all carry the same stress (Arts et al. 1991): p = stress/3 ln(1 + wall/V).
Parts of the wall are activated one after the other; valves are diodes; the aorta is a three-element Windkessel; steps are
implicit in the volume. Active stress: Tanh (Niederer et al. 2011), or Land et al. 2017 with Rice's calcium or a given transient.
"""
import json
import math
import struct
import sys
from pathlib import Path

KPA_TO_MMHG = 7.500615758456564


class Diverged(Exception):
    pass


class Tanh:
    calcium = False

    def __init__(self, p):
        self.p = p

    def rest(self, cycle):
        return None

    def step(self, state, stretch, stretch_before, since, dt):
        """Stress in kPa, state, calcium."""
        p, t = self.p, since - self.p["t_emd_ms"]
        if not 0 < t < p["t_CR_ms"]:
            return 0.0, None, 0.0
        phi = max(0.0, math.tanh(p["a6"] * (stretch - p["a7"])))
        rise = p["tau_SR_ref_ms"] + p["a4_ms"] * (1 - phi)
        fall = (p["t_CR_ms"] - t) / p["tau_SD_ms"]
        return p["Smax_ref_kPa"] * phi * math.tanh(t / rise) ** 2 * math.tanh(fall) ** 2, None, 0.0


class Land:
    calcium = True

    def __init__(self, p, calcium):
        self.p, self.calcium_at = p, calcium
        r_w, r_s = p["r_W"], p["r_S"]
        self.k_b = p["k_U_per_ms"] * p["TRPN50"] ** p["n_Tm"] / (1 - r_s - (1 - r_s) * r_w)
        self.k_wu = p["k_UW_per_ms"] * (1 / r_w - 1) - p["k_WS_per_ms"]
        self.k_su = p["k_WS_per_ms"] * r_w * (1 / r_s - 1)
        self.a = p["A_eff"] * r_s / ((1 - r_s) * r_w + r_s)
        self.c_w = p["phi"] * p["k_UW_per_ms"] * (1 - r_w) / r_w
        self.c_s = p["phi"] * p["k_WS_per_ms"] * r_w * (1 - r_s) / r_s

    def rest(self, cycle):
        """State at the end of some isometric beats."""
        state = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
        for _ in range(5):
            for k in range(int(cycle)):
                _, state, _ = self.step(state, 1.0, 1.0, k + 1.0, 1.0)
        return state

    def step(self, state, stretch, stretch_before, since, dt):
        p = self.p
        trpn, b, w, s, zw, zs = state
        ca = self.calcium_at(since)
        bent = min(stretch, 1.2)
        ca50 = p["Ca50_ref_uM"] + p["beta_1_uM"] * (bent - 1)
        bound = (ca / ca50) ** p["n_TRPN"]
        k = dt * p["k_TRPN_per_ms"]
        trpn = (trpn + k * bound) / (1 + k * (bound + 1))
        moved = self.a * (stretch - stretch_before)
        zw, zs = (zw + moved) / (1 + dt * self.c_w), (zs + moved) / (1 + dt * self.c_s)
        g_w = p["gamma_W_per_ms"] * abs(zw)
        g_s = p["gamma_S_per_ms"] * (-zs - 1 if zs < -1 else max(zs, 0.0))
        up = max(trpn, 1e-6) ** (p["n_Tm"] / 2)
        on, off = self.k_b / up, p["k_U_per_ms"] * up
        uw, ws = p["k_UW_per_ms"], p["k_WS_per_ms"]
        # Backward Euler: three linear equations for B, W, S, with U = 1 - B - W - S.
        m = [
            [1 + dt * (on + off), dt * on, dt * on],
            [dt * uw, 1 + dt * (uw + self.k_wu + ws + g_w), dt * uw],
            [0.0, -dt * ws, 1 + dt * (self.k_su + g_s)],
        ]
        b, w, s = solve3(m, [b + dt * on, w + dt * uw, s])
        h = max(0.0, 1 + p["beta_0"] * (bent + min(bent, 0.87) - 1.87))
        stress = h * p["Smax_ref_kPa"] / p["r_S"] * ((zs + 1) * s + zw * w)
        return stress, (trpn, b, w, s, zw, zs), ca


def solve3(m, v):
    def det(m):
        return (
            m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
            - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
        )

    whole = det(m)
    return [det([[v[i] if k == j else m[i][k] for k in range(3)] for i in range(3)]) / whole for j in range(3)]


def rice(p, cycle):
    rise, fall = p["tau_CR_ms"], p["tau_CD_ms"]
    if abs(rise - fall) < 1e-3:
        rise = fall + 1e-3
    r = rise / fall
    beta = r ** (-1 / (r - 1)) - r ** (-1 / (1 - 1 / r))

    def at(since):
        since = since % cycle  # before its activation a part sees the tail of the previous transient
        share = (math.exp(-since / rise) - math.exp(-since / fall)) / beta
        return p["Ca_res_uM"] + (p["Ca_max_uM"] - p["Ca_res_uM"]) * share

    return at


def sampled(file, cycle):
    rows = [line.split(",") for line in file.read_text().split("\n") if line and not line.startswith("#")]
    times, values = zip(*[(float(t), float(ca)) for t, ca, *_ in rows[1:]])

    def at(since):
        since = since % cycle
        for (t0, c0), (t1, c1) in zip(zip(times, values), zip(times[1:], values[1:])):
            if since <= t1:
                return c0 + (c1 - c0) * (since - t0) / (t1 - t0)
        return values[-1]

    return at


def model_of(given, folder):
    p, cycle = given["contraction"]["parameters"], given["cycle_length_ms"]
    kind = given["contraction"]["model"]
    if kind == "tanh":
        return Tanh(p)
    if kind == "land2017-rice":
        return Land(p, rice(p, cycle))
    if kind == "land2017-trace":
        return Land(p, sampled(folder / given["contraction"]["calcium_file"], cycle))
    sys.exit(2)


def simulate(given, folder, step=1.0):
    model = model_of(given, folder)
    start, load, valves = given["start"], given["circulation"], given["valves"]
    wall, unloaded, edv = start["wall_volume_mL"], start["unloaded_volume_mL"], start["end_diastolic_volume_mL"]
    cycle, atrium = given["cycle_length_ms"], load["left_atrial_pressure_mmHg"]
    r1 = load["afterload"]["characteristic_resistance_mmHg_s_per_mL"]
    r2 = load["afterload"]["peripheral_resistance_mmHg_s_per_mL"]
    c = load["afterload"]["compliance_mL_per_mmHg"]
    n = 6
    first, spread = given["activation"]["onset_ms"], given["activation"]["spread_ms"]
    onsets = [first + spread * (k + 0.5) / n for k in range(n)]

    def stretch_of(volume, reference):
        return ((volume + wall / 3) / (reference + wall / 3)) ** (1 / 3)

    def passive(volume):
        strain = (stretch_of(volume, unloaded) ** 2 - 1) / 2
        return start["stiffness_kPa"] * (math.exp(start["exponent"] * strain) - 1)

    states = [model.rest(cycle)] * n
    volume, stored = edv, load["initial_windkessel_pressure_mmHg"]
    pressure, rows = start["end_diastolic_pressure_mmHg"], []
    for beat in range(given["beats"]):
        rows = [(0.0, pressure, volume, stored, 0.0, 0.0, [0.0] * n, [0.0] * n, stretch_of(volume, edv))]
        for k in range(1, math.ceil(cycle / step - 1e-6) + 1):
            t = min(k * step, cycle)
            dt = t - rows[-1][0]
            before = stretch_of(volume, edv)

            def tried(new):
                """What the valves would let through at the pressure of a volume, less what its change asks for."""
                stretch = stretch_of(new, edv)
                parts = [model.step(s, stretch, before, t - at, dt) for s, at in zip(states, onsets)]
                active = sum(part[0] for part in parts) / n
                p = (active + passive(new)) / 3 * math.log(1 + wall / new) * KPA_TO_MMHG
                into = (atrium - p) / (valves["R_MV_f_mmHg_s_per_mL"] if atrium > p else valves["R_b_mmHg_s_per_mL"])
                share = 1e-3 * dt / c
                # The Windkessel at the step's end is linear in the outflow.
                kept, gain = stored / (1 + share / r2), share / (1 + share / r2)
                drop = p - kept
                valve = valves["R_AV_f_mmHg_s_per_mL"] if drop > 0 else valves["R_b_mmHg_s_per_mL"]
                out = drop / (valve + r1 + gain)
                return new - volume - 1e-3 * dt * (into - out), (p, kept + gain * out, out, into, parts, stretch)

            low, high = max(0.5 * volume, 1.0), 1.5 * volume
            f_low, _ = tried(low)
            f_high, _ = tried(high)
            if not (f_low < 0 < f_high):
                raise Diverged(f"no volume balances flow and pressure at {t} ms")
            for _ in range(100):  # Illinois: regula falsi that cannot stall
                new = (low * f_high - high * f_low) / (f_high - f_low)
                f, found = tried(new)
                if abs(f) < 1e-9:
                    break
                if f * f_high < 0:
                    low, f_low = high, f_high
                else:
                    f_low /= 2
                high, f_high = new, f
            volume = new
            pressure, stored, out, into, parts, stretch = found
            states = [part[1] for part in parts]
            rows.append((t, pressure, volume, stored + r1 * out, out, into, [x[0] for x in parts], [x[2] for x in parts], stretch))
        print(f"beat {beat + 1}: P_max {max(row[1] for row in rows):.1f} mmHg", flush=True)
    return model, onsets, rows


def igb(file, rows, quantity):
    n, frames = len(quantity(rows[0])), len(rows)
    span = rows[-1][0] - rows[0][0]
    head = f"x:{n} y:1 z:1 t:{frames} type:float systeme:little_endian org_t:0 dim_t:{span} unites_t:ms facteur:1 zero:0 \r\n"
    numbers = [value for row in rows for value in quantity(row)]
    file.write_bytes(head.encode().ljust(1023) + b"\x0c" + struct.pack(f"<{len(numbers)}f", *numbers))


def write(out, model, onsets, rows, as_igb):
    names = "time_ms,pressure_mmHg,volume_mL,aortic_pressure_mmHg,aortic_flow_mL_per_s,mitral_flow_mL_per_s"
    lines = [",".join(f"{x:.9g}" for x in row[:6]) for row in rows]
    (out / "traces.csv").write_text("\n".join([names, *lines, ""]))
    n = len(onsets)
    if as_igb:
        # Frames of an .igb file are equally far apart: a last, shorter step is left out.
        rows = rows if abs(rows[-1][0] - 2 * rows[-2][0] + rows[-3][0]) < 1e-6 else rows[:-1]
        igb(out / "Sa.igb", rows, lambda row: row[6])
        igb(out / "lambda.igb", rows, lambda row: [row[8]] * n)
        if model.calcium:
            igb(out / "Ca.igb", rows, lambda row: row[7])
        (out / "lat.dat").write_text("".join(f"{t}\n" for t in onsets))
        return
    columns = ["Sa_kPa", *(["Ca_uM"] if model.calcium else []), "lambda"]
    head = ["# activation_ms: " + ",".join(map(str, onsets)), "# weight: " + ",".join([str(1 / n)] * n)]
    head.append(",".join(["time_ms", *(f"{name}[{k}]" for name in columns for k in range(1, n + 1))]))
    for row in rows:
        values = [row[0], *row[6], *(row[7] if model.calcium else []), *([row[8]] * n)]
        head.append(",".join(f"{x:.9g}" for x in values))
    (out / "nodal.csv").write_text("\n".join([*head, ""]))


def main():
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    out = Path(sys.argv[2])
    given = json.loads(Path(sys.argv[1]).read_text())
    try:
        model, onsets, rows = simulate(given, out)
    except (Diverged, OverflowError, ZeroDivisionError) as error:
        print(f"diverged: {error}", file=sys.stderr)
        sys.exit(3)
    write(out, model, onsets, rows, "--igb" in sys.argv)


if __name__ == "__main__":
    main()
