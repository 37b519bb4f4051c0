"""Active stress of many cells at once, as cardiotwin defines it (docs/models.md), with NumPy alone.

A model has `begin()` for the state at the start of a beat, and `step(state, stretch, before, t, dt)`, which returns active
stress in kPa, the new state and calcium in µM. `stretch` and `before` are the stretches at the end and at the start of the step.
"""
import numpy as np


class Tanh:
    """Niederer et al. 2011: the stress follows from stretch and time since activation."""

    has_calcium = False

    def __init__(self, p, onset_ms):
        self.p, self.onset = p, onset_ms

    def begin(self):
        return np.zeros((0, self.onset.size))

    def step(self, state, stretch, before, t, dt):
        p = self.p
        since = t - self.onset - p["t_emd_ms"]
        phi = np.maximum(0.0, np.tanh(p["a6"] * (stretch - p["a7"])))
        rise = np.tanh(since / (p["tau_SR_ref_ms"] + p["a4_ms"] * (1 - phi))) ** 2
        fall = np.tanh((p["t_CR_ms"] - since) / p["tau_SD_ms"]) ** 2
        active = (since > 0) & (since < p["t_CR_ms"])
        return np.where(active, p["Smax_ref_kPa"] * phi * rise * fall, 0.0), state, np.zeros_like(stretch)


class Land:
    """Land et al. 2017; calcium is a function of the time since activation. Substeps of 1 ms at most, implicit in all states."""

    has_calcium = True

    def __init__(self, p, onset_ms, cycle_ms, calcium):
        self.p, self.onset, self.cycle, self.calcium = p, onset_ms, cycle_ms, calcium
        r_w, r_s = p["r_W"], p["r_S"]
        self.k_b = p["k_U_per_ms"] * p["TRPN50"] ** p["n_Tm"] / (1 - r_s - (1 - r_s) * r_w)
        self.k_wu = p["k_UW_per_ms"] * (1 / r_w - 1) - p["k_WS_per_ms"]
        self.k_su = p["k_WS_per_ms"] * r_w * (1 / r_s - 1)
        self.a = p["A_eff"] * r_s / ((1 - r_s) * r_w + r_s)
        self.c_w = p["phi"] * p["k_UW_per_ms"] * (1 - r_w) / r_w
        self.c_s = p["phi"] * p["k_WS_per_ms"] * r_w * (1 - r_s) / r_s

    def begin(self):
        """Each cell where it is in its isometric, periodic beat: its own activation is still to come."""
        n = int(round(self.cycle))
        state = np.zeros((6, 1))
        state[1] = 1.0
        one, kept = np.ones(1), []
        for beat in range(6):
            kept = [state]
            for k in range(n):
                _, state, _ = self._substep(state, one, one, np.full(1, k + 1.0), 1.0)
                kept.append(state)
        phase = np.round((-self.onset) % self.cycle).astype(int)
        return np.concatenate(kept, axis=1)[:, np.minimum(phase, n)]

    def step(self, state, stretch, before, t, dt):
        n = max(1, int(np.ceil(dt - 1e-9)))
        for k in range(1, n + 1):
            old, new = (before + (stretch - before) * share / n for share in (k - 1, k))
            stress, state, ca = self._substep(state, new, old, t - dt + k * dt / n - self.onset, dt / n)
        return stress, state, ca

    def _substep(self, state, stretch, before, since, dt):
        p = self.p
        trpn, b, w, s, zw, zs = state
        ca = self.calcium(since % self.cycle)
        bent = np.minimum(stretch, 1.2)
        ca50 = p["Ca50_ref_uM"] + p["beta_1_uM"] * (bent - 1)
        k = dt * p["k_TRPN_per_ms"]
        bound = (ca / ca50) ** p["n_TRPN"]
        trpn = (trpn + k * bound) / (1 + k * (bound + 1))
        moved = self.a * (stretch - before)
        zw, zs = (zw + moved) / (1 + dt * self.c_w), (zs + moved) / (1 + dt * self.c_s)
        g_w = p["gamma_W_per_ms"] * np.abs(zw)
        g_s = p["gamma_S_per_ms"] * np.where(zs < -1, -zs - 1, np.maximum(zs, 0.0))
        up = np.maximum(trpn, 1e-6) ** (p["n_Tm"] / 2)
        on, off = self.k_b / up, p["k_U_per_ms"] * up
        uw, ws = p["k_UW_per_ms"], p["k_WS_per_ms"]
        # Backward Euler for B, W, S with U = 1 - B - W - S. The last equation gives S of W; two are left.
        of_w = dt * ws / (1 + dt * (self.k_su + g_s))
        s_0 = s / (1 + dt * (self.k_su + g_s))
        m11, m12, r1 = 1 + dt * (on + off), dt * on * (1 + of_w), b + dt * on * (1 - s_0)
        m21, m22 = dt * uw, 1 + dt * (uw * (1 + of_w) + self.k_wu + ws + g_w)
        r2 = w + dt * uw * (1 - s_0)
        determinant = m11 * m22 - m12 * m21
        b, w = (r1 * m22 - r2 * m12) / determinant, (m11 * r2 - m21 * r1) / determinant
        s = s_0 + of_w * w
        h = np.maximum(0.0, 1 + p["beta_0"] * (bent + np.minimum(bent, 0.87) - 1.87))
        stress = h * p["Smax_ref_kPa"] / p["r_S"] * ((zs + 1) * s + zw * w)
        return stress, np.array([trpn, b, w, s, zw, zs]), ca * np.ones_like(stretch)


def rice(p):
    """Rice's calcium transient, (s/τ) e^(1 − s/τ) where both time constants are equal."""
    rise, fall = p["tau_CR_ms"], p["tau_CD_ms"]
    if abs(rise - fall) < 1e-3:
        rise = fall + 1e-3
    r = rise / fall
    beta = r ** (-1 / (r - 1)) - r ** (-1 / (1 - 1 / r))
    over = p["Ca_max_uM"] - p["Ca_res_uM"]
    return lambda since: p["Ca_res_uM"] + over / beta * (np.exp(-since / rise) - np.exp(-since / fall))


def sampled(file):
    """A given transient: columns time_ms and Ca_uM."""
    rows = [line for line in file.read_text().splitlines() if line.strip() and not line.startswith("#")]
    time_ms, calcium = np.array([[float(x) for x in row.split(",")[:2]] for row in rows[1:]]).T
    return lambda since: np.interp(since, time_ms, calcium)


def model_of(given, folder, onset_ms):
    p, kind, cycle = given["contraction"]["parameters"], given["contraction"]["model"], given["cycle_length_ms"]
    if kind == "tanh":
        return Tanh(p, onset_ms)
    if kind == "land2017-rice":
        return Land(p, onset_ms, cycle, rice(p))
    if kind == "land2017-trace":
        return Land(p, onset_ms, cycle, sampled(folder / given["contraction"]["calcium_file"]))
    raise ValueError(f"contraction.model is {kind}: expected tanh, land2017-rice or land2017-trace")
