"""The 0D cell in Python, for SciPy's solvers: seven differential equations, the stretch a scalar root in each right-hand side.

Equations and sources: docs/models.md. Written apart from the Rust code; `work_precision.py` compares its beats with the
stored reference before it measures anything.
"""

import math

import numpy as np

# Order of `parameters` in tests/data/cell0d.json.
NAMES = (
    "kTRPN nTRPN Ca50 kU nTm TRPN50 kUW kWS rW rS gammaS gammaW phi Aeff beta0 beta1 Smax Cares Camax tauCR tauCD ap".split()
)
B_PASSIVE, K_PASSIVE, ETA_LENGTHENING_MS, ETA_SHORTENING_MS = 9.1, 7.0, 200.0, 20.0


def constants(parameters, lambda_0):
    """What the right-hand side needs, computed once."""
    p = dict(zip(NAMES, parameters))
    k_b = p["kU"] * p["TRPN50"] ** p["nTm"] / (1 - p["rS"] - (1 - p["rS"]) * p["rW"])
    k_wu = p["kUW"] * (1 / p["rW"] - 1) - p["kWS"]
    k_su = p["kWS"] * p["rW"] * (1 / p["rS"] - 1)
    a = p["Aeff"] * p["rS"] / ((1 - p["rS"]) * p["rW"] + p["rS"])
    c_w = p["phi"] * p["kUW"] * (1 - p["rW"]) / p["rW"]
    c_s = p["phi"] * p["kWS"] * p["rW"] * (1 - p["rS"]) / p["rS"]
    slow, fast = 1 / max(p["tauCR"], p["tauCD"]), 1 / min(p["tauCR"], p["tauCD"])
    gap = fast - slow
    if gap < 1e-9 * slow:
        peak = math.exp(-1.0) / slow
    else:
        t_peak = math.log(fast / slow) / gap
        peak = math.exp(-slow * t_peak) * -math.expm1(-gap * t_peak)
    return np.array(
        [p["kTRPN"], p["nTRPN"], p["Ca50"], p["beta1"], k_b, p["kU"], p["nTm"], p["kUW"], p["kWS"], k_wu, k_su]
        + [p["gammaW"], p["gammaS"], a, c_w, c_s, p["beta0"], p["Smax"] / p["rS"], p["ap"], lambda_0]
        + [p["Cares"], p["Camax"], slow, gap, peak]
    )


def right_hand_side(compiled):
    """`(rhs(t, y, c), stress_and_stretch(y, c), rest(c))`, in Python or compiled by numba; y = TRPN, U, W, S, z_W, z_S, C_V."""
    if compiled:
        from numba import njit
    else:
        njit = lambda function: function  # noqa: E731

    @njit
    def calcium(t, c):
        resting, largest, slow, gap, peak = c[20], c[21], c[22], c[23], c[24]
        if gap < 1e-9 * slow:
            shape = t * math.exp(-slow * t)
        else:
            shape = -math.exp(-slow * t) * math.expm1(-gap * t)
        return resting + (largest - resting) * shape / peak

    @njit
    def active(y, stretch, c):
        a, beta_0, scale = c[13], c[16], c[17]
        length = min(stretch, 1.2)
        h = max(0.0, 1 + beta_0 * (length + min(length, 0.87) - 1.87))
        slope = 0.0 if h == 0.0 or stretch > 1.2 else beta_0 * (2.0 if stretch < 0.87 else 1.0)
        pull = (y[5] + a * stretch + 1) * y[3] + (y[4] + a * stretch) * y[2]
        return h * scale * pull, scale * (slope * pull + h * a * (y[3] + y[2]))

    @njit
    def stretch_of(y, c):
        """Root of active + passive stress: Newton's method inside a bracket that shrinks."""
        a_p, lambda_0 = c[18], c[19]
        low, high = 0.3 * lambda_0, 1.7 * lambda_0
        x = lambda_0 * (1 + y[6])
        for _ in range(100):
            sa, slope = active(y, x, c)
            strain = x / lambda_0 - 1
            e = math.exp(B_PASSIVE * strain)
            f = sa + a_p * (e - 1 + K_PASSIVE * (strain - y[6]))
            slope += a_p * (B_PASSIVE * e + K_PASSIVE) / lambda_0
            if f > 0:
                high = x
            else:
                low = x
            new = x - f / slope
            if not low <= new <= high:
                new = 0.5 * (low + high)
            if abs(new - x) <= 1e-15 * lambda_0:
                return new
            x = new
        return x

    @njit
    def rhs(t, y, c):
        stretch = stretch_of(y, c)
        trpn, unbound, w, s = y[0], y[1], y[2], y[3]
        zeta_w, zeta_s = y[4] + c[13] * stretch, y[5] + c[13] * stretch
        ca_50 = c[2] + c[3] * (min(stretch, 1.2) - 1)
        # A trial step of an explicit predictor may leave the range in which powers exist.
        power = max(trpn, 1e-12) ** (0.5 * c[6])
        # U in the place of B: 1 - B - W - S of a nearly inactive cell has no digits.
        blocking = c[4] / power * unbound - c[5] * power * (1 - unbound - w - s)
        gamma_wu = c[11] * abs(zeta_w)
        gamma_su = c[12] * (-zeta_s - 1 if zeta_s < -1 else max(zeta_s, 0.0))
        strain = stretch / c[19] - 1 - y[6]
        eta = ETA_LENGTHENING_MS if strain > 0 else ETA_SHORTENING_MS
        return np.array(
            [
                c[0] * ((calcium(t, c) / ca_50) ** c[1] * (1 - trpn) - trpn),
                -blocking - c[7] * unbound + (c[9] + gamma_wu) * w + (c[10] + gamma_su) * s,
                c[7] * unbound - (c[9] + c[8] + gamma_wu) * w,
                c[8] * w - (c[10] + gamma_su) * s,
                -c[14] * zeta_w,
                -c[15] * zeta_s,
                K_PASSIVE / eta * strain,
            ]
        )

    @njit
    def stress_and_stretch(y, c):
        stretch = stretch_of(y, c)
        return active(y, stretch, c)[0], stretch

    @njit
    def rest(c):
        """The static equilibrium at resting calcium."""
        y, stretch = np.zeros(7), c[19]
        for _ in range(50):
            r = (c[20] / (c[2] + c[3] * (min(stretch, 1.2) - 1))) ** c[1]
            y[0] = r / (1 + r)
            power = y[0] ** (0.5 * c[6])
            b, w = c[4] / (c[5] * power * power), c[7] / (c[9] + c[8])
            s = w * c[8] / c[10]
            unbound = 1 / (1 + b + w + s)
            y[1], y[2], y[3] = unbound, w * unbound, s * unbound
            y[4] = y[5] = -c[13] * stretch
            y[6] = stretch / c[19] - 1
            # The dashpot gives way: what balances the active stress is the exponential spring alone.
            sa = active(y, stretch, c)[0]
            stretch = c[19] * (1 + math.log(max(1 - sa / c[18], 1e-3)) / B_PASSIVE)
        return y

    return rhs, stress_and_stretch, rest
