"""Reference for Land 2017 under a prescribed stretch that changes: `land2017_changing_stretch.json`, beside this script.

The equations are written here from Jung et al. 2022, eqs. A4 to A16, in the reading of docs/models.md; nothing is taken from
the Rust code. Units: ms, kPa, uM; stretch and states without unit.

    pip install numpy==2.4.6 scipy==1.17.1
    python solver/models/tests/data/land2017_changing_stretch.py
"""

import json
import math
import pathlib

import numpy as np
from scipy.integrate import solve_ivp

SAMPLES_MS = np.arange(0.0, 601.0, 10.0)
DEFAULTS = {
    "k_TRPN_per_ms": 0.1, "n_TRPN": 2.0, "Ca50_ref_uM": 0.805, "k_U_per_ms": 1.0, "n_Tm": 5.0, "TRPN50": 0.35,
    "k_UW_per_ms": 0.182, "k_WS_per_ms": 0.012, "r_W": 0.5, "r_S": 0.25, "gamma_S_per_ms": 0.0085,
    "gamma_W_per_ms": 0.615, "phi": 2.23, "A_eff": 25.0, "beta_0": 2.3, "beta_1_uM": -2.4, "Smax_ref_kPa": 120.0,
    "Ca_res_uM": 0.15, "Ca_max_uM": 0.6, "tau_CR_ms": 129.0, "tau_CD_ms": 128.0,
}  # fmt: skip
# Stretch: mean + sum of amplitude * sin(2 pi t / period + phase).
GENTLE = {"mean": 0.94, "waves": [[0.06, 500.0, 1.2]]}
# Passes 0.87 (overlap) and 1.2 (end of length dependence), and drives zeta_S across 0 and -1.
WIDE = {"mean": 0.98, "waves": [[0.17, 400.0, 1.5], [0.08, 150.0, 0.0]]}
CASES = [
    ("defaults", {}, False, GENTLE),
    ("wide_stretch", {}, False, WIDE),
    ("capped_unblocking", {}, True, WIDE),
    (
        "strong_distortion",
        {"A_eff": 37.0, "gamma_S_per_ms": 0.02, "gamma_W_per_ms": 2.5, "phi": 0.5, "beta_0": 4.4, "r_W": 0.3},
        False,
        WIDE,
    ),
    (
        "fast_and_sensitive",
        {
            "k_TRPN_per_ms": 0.35, "n_TRPN": 3.6, "Ca50_ref_uM": 1.1, "n_Tm": 3.3, "TRPN50": 0.45, "k_UW_per_ms": 0.3,
            "k_WS_per_ms": 0.04, "r_W": 0.4, "r_S": 0.15, "beta_1_uM": -3.4, "Ca_max_uM": 0.85, "tau_CR_ms": 75.0,
            "tau_CD_ms": 150.0, "Smax_ref_kPa": 135.0, "k_U_per_ms": 0.2,
        },
        False,
        WIDE,
    ),
]  # fmt: skip


def stretch(law, t):
    """Stretch and its rate."""
    value, rate = law["mean"], 0.0
    for amplitude, period, phase in law["waves"]:
        omega = 2 * math.pi / period
        value += amplitude * math.sin(omega * t + phase)
        rate += amplitude * omega * math.cos(omega * t + phase)
    return value, rate


def calcium(p, t):
    """Eq. A16, activated at t = 0."""
    rise, decay = p["tau_CR_ms"], p["tau_CD_ms"]
    r = rise / decay
    beta = r ** (-1 / (r - 1)) - r ** (-1 / (1 - 1 / r))
    return p["Ca_res_uM"] + (p["Ca_max_uM"] - p["Ca_res_uM"]) / beta * (math.exp(-t / rise) - math.exp(-t / decay))


def constants(p):
    free = 1 - p["r_S"] - (1 - p["r_S"]) * p["r_W"]
    duty = (1 - p["r_S"]) * p["r_W"] + p["r_S"]
    return {
        "k_B": p["k_U_per_ms"] * p["TRPN50"] ** p["n_Tm"] / free,
        "k_WU": p["k_UW_per_ms"] * (1 / p["r_W"] - 1) - p["k_WS_per_ms"],
        "k_SU": p["k_WS_per_ms"] * p["r_W"] * (1 / p["r_S"] - 1),
        "A": p["A_eff"] * p["r_S"] / duty,
        "c_W": p["phi"] * p["k_UW_per_ms"] * (1 - p["r_W"]) / p["r_W"],
        "c_S": p["phi"] * p["k_WS_per_ms"] * p["r_W"] * (1 - p["r_S"]) / p["r_S"],
    }


def rates(p, k, capped, ca, lam, dlam, y):
    """Rates of CaTRPN, B, W, S, zeta_W, zeta_S [1/ms]."""
    trpn, b, w, s, zeta_w, zeta_s = y
    unbound = 1 - b - w - s
    ca50 = p["Ca50_ref_uM"] + p["beta_1_uM"] * (min(lam, 1.2) - 1)
    unblocking = trpn ** (-p["n_Tm"] / 2)
    if capped:
        unblocking = min(unblocking, 100.0)
    gamma_wu = p["gamma_W_per_ms"] * abs(zeta_w)
    gamma_su = p["gamma_S_per_ms"] * (-zeta_s - 1 if zeta_s < -1 else max(zeta_s, 0.0))
    return [
        p["k_TRPN_per_ms"] * ((ca / ca50) ** p["n_TRPN"] * (1 - trpn) - trpn),
        k["k_B"] * unblocking * unbound - p["k_U_per_ms"] * trpn ** (p["n_Tm"] / 2) * b,
        p["k_UW_per_ms"] * unbound - k["k_WU"] * w - p["k_WS_per_ms"] * w - gamma_wu * w,
        p["k_WS_per_ms"] * w - k["k_SU"] * s - gamma_su * s,
        k["A"] * dlam - k["c_W"] * zeta_w,
        k["A"] * dlam - k["c_S"] * zeta_s,
    ]


def stress(p, lam, y):
    l = min(lam, 1.2)
    h = max(0.0, 1 + p["beta_0"] * (l + min(l, 0.87) - 1.87))
    return h * p["Smax_ref_kPa"] / p["r_S"] * ((y[5] + 1) * y[3] + y[4] * y[2])


def solve(p, capped, law, method, rtol):
    k = constants(p)
    start = [0.07, 0.95, 0.01, 0.005, 0.0, 0.0]

    def right_hand_side(t, y):
        return rates(p, k, capped, calcium(p, t), *stretch(law, t), y)

    solution = solve_ivp(
        right_hand_side, (0.0, SAMPLES_MS[-1]), start, method, SAMPLES_MS, rtol=rtol, atol=1e-14, max_step=1.0
    )
    assert solution.success, solution.message
    return solution.y.T


def case(name, changes, capped, law):
    p = DEFAULTS | changes
    k = constants(p)
    states = solve(p, capped, law, "LSODA", 1e-12)
    other = solve(p, capped, law, "Radau", 1e-10)
    samples = []
    difference = 0.0
    for t, y, z in zip(SAMPLES_MS, states, other):
        (lam, dlam), ca = stretch(law, t), calcium(p, t)
        difference = max(difference, abs(stress(p, lam, y) - stress(p, lam, z)))
        samples.append(
            {
                "t_ms": t,
                "Ca_uM": ca,
                "lambda": lam,
                "lambda_rate_per_ms": dlam,
                "states": list(map(float, y)),
                "rates_per_ms": list(map(float, rates(p, k, capped, ca, lam, dlam, y))),
                "Sa_kPa": float(stress(p, lam, y)),
            }
        )
    zeta_s = states[:, 5]
    print(f"{name:20} LSODA - Radau {difference:.1e} kPa, zeta_S {zeta_s.min():.2f} to {zeta_s.max():.2f}")
    return {
        "name": name,
        "parameters": p,
        "cap_unblocking": capped,
        "stretch_law": law,
        "largest_difference_of_two_solvers_kPa": difference,
        "samples": samples,
    }


def main():
    document = {
        "header": {
            "source": "land2017_changing_stretch.py: SciPy 1.17.1, LSODA, rtol 1e-12, atol 1e-14; checked against Radau",
            "units": "t ms, Ca uM, stretch and states without unit (CaTRPN, B, W, S, zeta_W, zeta_S), rates 1/ms, Sa kPa",
            "stretch_law": "mean + sum of amplitude * sin(2 pi t / period_ms + phase), waves as [amplitude, period_ms, phase]",
        },
        "cases": [case(*c) for c in CASES],
    }
    path = pathlib.Path(__file__).with_suffix(".json")
    text = json.dumps(document, separators=(",", ":")).replace('{"t_ms"', '\n{"t_ms"').replace('{"name"', '\n{"name"')
    path.write_text(text + "\n")


if __name__ == "__main__":
    main()
