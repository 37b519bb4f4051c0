"""Reported numbers, recomputed from raw files with NumPy and the standard library alone.

The formulas are those of docs/models.md, docs/mechanics.md and docs/formats.md.
Nothing of the program's code is used; `test_second_opinion.py` compares.
"""

from __future__ import annotations

import base64
import re
import zlib
from pathlib import Path

import numpy as np

# ---------------------------------------------------------------------------------------------------------- files


def columns(path):
    """Columns of a CSV file of numbers, by name. Lines that begin with # are comments."""
    lines = [line for line in Path(path).read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = [[float(x) if x else np.nan for x in line.split(",")] for line in lines[1:]]
    return dict(zip(lines[0].split(","), np.array(rows).T, strict=True))


def nodal(path):
    """Activation times, weights, and the nodes' traces by quantity, of `nodal.csv`."""
    with open(path, encoding="utf-8") as lines:
        head = [lines.readline().split(":")[1] for _ in range(2)]
        names = lines.readline().strip().split(",")
        values = np.loadtxt(lines, delimiter=",")
    activation, weight = (np.array([float(x) for x in text.split(",")]) for text in head)
    traces = {}
    for quantity in dict.fromkeys(name.split("[")[0] for name in names[1:]):
        traces[quantity] = values[:, [k for k, name in enumerate(names) if name.startswith(quantity + "[")]]
    return values[:, 0], activation, weight, traces


def vtu(path, *names):
    """Arrays of a VTU file in base64 with zlib, by name."""
    text = Path(path).read_text(encoding="ascii")
    kinds = {"Float32": "<f4", "Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}
    found = {}
    for name in names:
        match = re.search(
            rf'<DataArray type="(\w+)" Name="{name}" NumberOfComponents="(\d)"[^>]*>\s*([^<]*?)\s*<', text
        )
        code = match[3]
        # Blocks: their number, their size, the last one's size, and the packed sizes; then the blocks.
        n = int(np.frombuffer(base64.b64decode(code[:12])[:8], "<u8")[0])
        head = 4 * ((8 * (3 + n) + 2) // 3)
        sizes = np.frombuffer(base64.b64decode(code[:head]), "<u8", count=3 + n)[3:]
        packed, data, at = base64.b64decode(code[head:]), b"", 0
        for size in sizes:
            data += zlib.decompress(packed[at : at + int(size)])
            at += int(size)
        array = np.frombuffer(data, kinds[match[1]])
        found[name] = array.reshape(-1, int(match[2])) if match[2] != "1" else array
    return found


class Frames:
    """Positions of the mesh's nodes over a beat, of the folder `vtu`."""

    def __init__(self, folder):
        index = (Path(folder) / "beat.pvd").read_text(encoding="utf-8")
        found = re.findall(r'timestep="([^"]+)"[^>]*file="([^"]+)"', index)
        self.time = np.array([float(time) for time, _ in found])
        self.files = [Path(folder) / name for _, name in found]
        self.x = np.array([vtu(file, "Points")["Points"] for file in self.files], dtype=float)
        self.tets = vtu(self.files[0], "connectivity")["connectivity"].reshape(-1, 4)
        self.tags = vtu(self.files[0], "tag")["tag"]

    def at(self, time):
        """Positions at a time, linear between frames."""
        k = int(np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2))
        share = np.clip((time - self.time[k]) / (self.time[k + 1] - self.time[k]), 0, 1)
        return self.x[k] + share * (self.x[k + 1] - self.x[k])


class Mesh:
    """A mesh in CARP's text format, in mm: nodes as imaged and unloaded, elements, tags, surfaces."""

    def __init__(self, folder):
        folder = Path(folder)
        self.image = points(folder / "heart.pts")
        self.unloaded = points(folder / "heart.unloaded.pts")
        rows = np.array([line.split()[1:6] for line in (folder / "heart.elem").read_text().splitlines()[1:]], dtype=int)
        self.tets, self.tags = rows[:, :4], rows[:, 4]
        self.surfaces = {file.name.split(".")[1]: triangles(file) for file in sorted(folder.glob("heart.*.surf"))}


def points(path):
    return np.loadtxt(path, skiprows=1) / 1000


def triangles(path):
    lines = Path(path).read_text().splitlines()[1:]
    return np.array([line.split()[1:4] for line in lines], dtype=int).reshape(-1, 3)


# ------------------------------------------------------------------------------------------------- traces of a beat


def to_1_ms(t, y, period=None):
    """Samples each millisecond: a periodic spline, or of one beat a monotone cubic; samples on the grid stay."""
    if period is None:
        grid = t[0] + np.arange(int(np.floor(t[-1] - t[0] + 1e-6)) + 1)
        if t[-1] - grid[-1] > 1e-6:
            grid = np.append(grid, t[-1])
        return (t, y) if np.array_equal(grid, t) else (grid, monotone(t, y, grid))
    step = (t[-1] - t[0]) / (len(t) - 1)
    inside = t - t[0] < period - 0.25 * step
    t, y, grid = t[inside], y[inside], np.arange(int(np.floor(period - 1e-6)) + 1, dtype=float)
    return (t, y) if np.array_equal(grid, t) else (grid, spline(t, y, period, grid))


def spline(t, y, period, grid):
    """The cubic spline that repeats after a period."""
    n = len(t)
    h = np.diff(np.append(t, t[0] + period))
    slope = (np.roll(y, -1) - y) / h
    matrix = np.zeros((n, n))
    for i in range(n):
        matrix[i, i - 1] += h[i - 1]
        matrix[i, i] += 2 * (h[i - 1] + h[i])
        matrix[i, (i + 1) % n] += h[i]
    second = np.linalg.solve(matrix, 6 * (slope - np.roll(slope, 1)))
    s = t[0] + (grid - t[0]) % period
    i = np.searchsorted(t, s, side="right") - 1
    b = (s - t[i]) / h[i]
    a, j = 1 - b, (i + 1) % n
    return a * y[i] + b * y[j] + ((a**3 - a) * second[i] + (b**3 - b) * second[j]) * h[i] ** 2 / 6


def monotone(t, y, grid):
    """The monotone cubic of Fritsch and Butland (1984)."""
    h, slope = np.diff(t), np.diff(y) / np.diff(t)
    d = np.empty(len(t))
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = (w1 + w2) / (w1 / slope[:-1] + w2 / slope[1:])
    d[1:-1] = np.where(slope[:-1] * slope[1:] > 0, inner, 0)
    d[0], d[-1] = slope[0], slope[-1]
    i = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    x = (grid - t[i]) / h[i]
    h00, h10 = 2 * x**3 - 3 * x**2 + 1, x**3 - 2 * x**2 + x
    return h00 * y[i] + h10 * h[i] * d[i] + (1 - h00) * y[i + 1] + (x**3 - x**2) * h[i] * d[i + 1]


def leaves(t, y, begin, step, level, rate):
    """Time at which a limb, followed from sample `begin` by steps, comes down to a level.

    The limb falls at least by `rate` per ms: a touch of the level earlier on does not count.
    """
    best = -np.inf
    i, sign = begin, step
    while 0 <= i < len(t):
        # Time from `begin` on, in the direction of the search; the earliest of the limb's extensions counts.
        extended = -(sign * t[i] + (y[i] - level) / rate)
        if y[i] <= level:
            j = i - step
            crossed = t[i] + (level - y[i]) / (y[j] - y[i]) * (t[j] - t[i])
            return sign * -max(best, -sign * crossed)
        best = max(best, extended)
        i += step
    return sign * -best


def half_way(y, begin, step, level):
    """Last sample above (below) a level on the way from `begin`, which is above (below)."""
    above = y[begin] > level
    i = begin
    while 0 <= i + step < len(y) and (y[i + step] > level) == above:
        i += step
    return i


def biomarkers(pressure, volume, measured_edv=None, period=None):
    """Biomarkers and their times by docs/models.md, section 1.

    Traces are pairs of times and values, or None; `period` is the cycle length of a measured beat.
    """
    found = {}
    if pressure is not None:
        found |= of_pressure(*to_1_ms(*pressure, period), period)
    if volume is not None:
        found |= of_volume(*to_1_ms(*volume, period), period)
        if measured_edv is not None:
            found["end_of_beat_gap_mL"] = measured_edv - volume[1][-1]
    return found


def unrolled(t, y, period):
    """A periodic trace, three times in a row: its middle part has neighbours on both sides."""
    return (np.concatenate([t - period, t, t + period]), np.tile(y, 3)) if period else (t, y)


def of_pressure(t, p, period=None):
    n, first = len(t), p[0]
    t, p = unrolled(t, p, period)
    top = int(p[:n].argmax()) + (n if period else 0)
    low, high = p.min(), p.max()
    rate = np.full(len(p), np.nan)
    rate[1:-1] = (p[2:] - p[:-2]) / (t[2:] - t[:-2])
    begin, end = (top - n // 2, top + n // 2 + 1) if period else (0, n)
    level, steep = low + 0.1 * (high - low), (high - low) / 500
    half = low + 0.5 * (high - low)
    t1 = leaves(t, p, half_way(p, top, -1, half), -1, level, steep)
    t3 = min(leaves(t, p, half_way(p, top, 1, half), 1, level, steep), t[-1])
    return {
        "P_max_mmHg": high,
        "EDP_mmHg": first,
        "dPdt_max_mmHg_per_ms": np.nanmax(rate[begin:top]),
        "dPdt_min_mmHg_per_ms": np.nanmin(rate[top + 1 : end]),
        "PTD90_ms": t3 - t1,
        "t1_ms": t1,
        "t2_ms": t[top],
        "t3_ms": t3,
    }


def of_volume(t, v, period=None):
    n, first = len(t), v[0]
    t, v = unrolled(t, v, period)
    bottom = int(v[:n].argmin()) + (n if period else 0)
    low, sv = v.min(), v.max() - v.min()
    steep = sv / 2000
    before = slice(bottom - n, bottom + 1) if period else slice(0, bottom + 1)
    after = slice(bottom, bottom + n + 1) if period else slice(bottom, n)
    high = v[before].max() - low
    upper, lower = min(0.9, high / sv), 0.1

    def within(time):
        return float(np.clip(time, t[0], t[-1]))

    # Ejection: from a sample in its middle back to the fullest and on to the emptiest volumes.
    middle = half_way(v, bottom, -1, low + 0.5 * (upper + lower) * sv)
    full = {x: within(leaves(t, -v, middle, -1, -(low + x * sv), steep)) for x in (high / sv - 1e-3, upper)}
    empty = {x: within(leaves(t, v, middle - 1, 1, low + x * sv, steep)) for x in (1e-3, lower)}
    found = {
        "SV_mL": sv,
        "EDV_mL": first,
        "ESV_mL": low,
        "t4_ms": full[high / sv - 1e-3],
        "t5_ms": empty[1e-3],
        "tau_VD_ms": time_constant(t, v, full[upper], empty[lower], lambda x: (x - low) / sv),
    }
    recovered = min(v[after].max() - low, 0.8 * sv)
    middle = half_way(v, bottom, 1, low + 0.5 * recovered)
    full = {x: within(leaves(t, -v, middle, 1, -(low + x), steep)) for x in (0.8 * sv, 0.9 * recovered)}
    empty = {x: within(leaves(t, v, middle + 1, -1, low + x, steep)) for x in (1e-3 * sv, 0.1 * recovered)}
    return found | {
        "t6_ms": empty[1e-3 * sv],
        "t7_ms": full[0.8 * sv],
        "tau_VR_ms": time_constant(
            t, v, empty[0.1 * recovered], full[0.9 * recovered], lambda x: 1 - (x - low) / recovered
        ),
    }


def time_constant(t, v, begin, end, argument):
    """-1/slope of the regression of ln(argument) on time, as an integral; the logarithm is linear between samples."""
    knots = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
    y = np.log(argument(np.interp(knots, t, v)))
    x = knots - 0.5 * (begin + end)
    pieces = np.diff(x) / 6 * (x[:-1] * (2 * y[:-1] + y[1:]) + x[1:] * (y[:-1] + 2 * y[1:]))
    return -((end - begin) ** 3 / 12) / pieces.sum()


def volume_balance(t, volume, inflow, outflow, is_of_second_order=False):
    """Change of the volume less what the valves let through, mL: flows belong to the end of their step, or to both
    ends in a circulation of second order."""
    flow = inflow - outflow
    of_step = 0.5 * (flow[1:] + flow[:-1]) if is_of_second_order else flow[1:]
    net = (of_step * np.diff(t)).sum() / 1000
    return volume[-1] - volume[0] - net


# ------------------------------------------------------------------------------------------------------------ costs

OF_COST = ("P_max_mmHg", "dPdt_max_mmHg_per_ms", "dPdt_min_mmHg_per_ms", "PTD90_ms", "tau_VD_ms", "tau_VR_ms")


def differences(measured, simulated):
    """(simulated - measured) / measured, of each measured biomarker of the cost."""
    return {key: simulated[key] / measured[key] - 1 for key in OF_COST if measured.get(key) is not None}


def weighted(measured, simulated, weights):
    """Step 1's weighted sum of squared relative differences; a biomarker without a simulated value counts as 1.
    Without other weights it is the cost."""
    weights = dict.fromkeys(OF_COST, 1.0) | weights
    terms = ((key, w) for key, w in weights.items() if w > 0 and measured.get(key) is not None)
    return sum(
        w * (simulated[key] / measured[key] - 1 if simulated.get(key) is not None else 1) ** 2 for key, w in terms
    )


def misfit(measured, simulated, percent, samples, own, deviations, cycle):
    """Step 3's sum of squared differences over variances: of biomarkers and of the traces' forty samples."""
    total = sum(
        (((simulated[key] / measured[key]) - 1) / (0.01 * sd)) ** 2
        for key, sd in percent.items()
        if measured.get(key) is not None
    )
    for key in ("pressure_mmHg", "volume_mL"):
        if samples.get(key) and deviations[key] > 0:
            difference = np.array(own[key]) - np.array(samples[key])
            total += cycle / deviations["correlation_ms"] * np.mean(difference**2) / deviations[key] ** 2
    return total


def stress(t, sa, stretch):
    """Biomarkers of an active stress, whose baseline is zero."""
    top = int(sa.argmax())
    rate = np.zeros(len(sa))
    rate[1:-1] = (sa[2:] - sa[:-2]) / (t[2:] - t[:-2])

    def crossing(level, step):
        i = half_way(sa, top, step, level)
        j = i + step
        if not 0 <= j < len(t):
            return t[i]
        return t[i] + (level - sa[i]) / (sa[j] - sa[i]) * (t[j] - t[i])

    lasts = {name: crossing(x * sa[top], 1) - crossing(x * sa[top], -1) for name, x in LEVELS.items()}
    return {"Sa_max_kPa": sa[top], "dSadt_max_kPa_per_ms": rate[1:top].max(), **lasts, "lambda_min": stretch.min()}


LEVELS = {"STD30_ms": 0.7, "STD50_ms": 0.5, "STD90_ms": 0.1}
CELL_WEIGHTS = {
    "Sa_max_kPa": 5,
    "dSadt_max_kPa_per_ms": 1,
    "STD30_ms": 5,
    "STD50_ms": 1,
    "STD90_ms": 1,
    "lambda_min": 100,
}


def cell_cost(t, sa, stretch, targets, values, lambda_max):
    """Terms of step 2's cost (docs/models.md, section 6), of the fitted cell's traces and parameters."""
    mine = stress(t, sa, stretch)
    terms = {key: w * ((targets[key] - mine[key]) / targets[key]) ** 2 for key, w in CELL_WEIGHTS.items()}
    top = int(sa.argmax())
    rises = np.maximum(np.diff(sa[top:]) / np.diff(t[top:]), 0)
    terms["penalty_resting_stress"] = sa[0] ** 2
    terms["penalty_negative_stress"] = float((0.5 * (np.minimum(sa, 0)[1:] ** 2 + np.minimum(sa, 0)[:-1] ** 2)).sum())
    terms["penalty_rise_after_maximum"] = float((rises**2 * np.diff(t[top:])).sum())
    if {"tau_CR_ms", "tau_CD_ms"} <= values.keys():
        half, most = calcium_durations(values["tau_CR_ms"], values["tau_CD_ms"])
        terms["penalty_CTD50"] = max(0, 120 - half) ** 2 + max(0, half - 420) ** 2
        terms["penalty_CTD90"] = max(0, 220 - most) ** 2 + max(0, most - 785) ** 2
    if {"Ca_res_uM", "Ca50_ref_uM", "beta_1_uM"} <= values.keys():
        sensitivity = values["Ca50_ref_uM"] + values["beta_1_uM"] * (min(lambda_max, 1.2) - 1)
        terms["penalty_Ca50"] = 100 * max(0, 1 - sensitivity / values["Ca_res_uM"]) ** 2
    return mine, terms


def calcium_durations(rise, decay):
    """Times from activation to 50 and 90 % decay of Rice's transient."""
    s = np.linspace(0, 4000, 400_001)
    if abs(rise / decay - 1) < 1e-6:
        curve = s * np.exp(-s / rise)
    else:
        curve = (np.exp(-s / rise) - np.exp(-s / decay)) / (rise - decay)
    curve /= curve.max()
    top = curve.argmax()
    return [s[top + np.argmax(curve[top:] <= share)] for share in (0.5, 0.1)]


def medians(t, activation, weight, trace):
    """The weighted median over nodes at each time since their activation, linear between samples and between values."""
    step = t[1] - t[0]
    last = activation.max()
    times = step * np.arange(int(np.floor((t[-1] - last) / step + 1e-9)) + 1)
    found = np.empty(len(times))
    for k, time in enumerate(times):
        values = np.array([np.interp(time + a, t, trace[:, i]) for i, a in enumerate(activation)])
        order = values.argsort()
        w = weight[order]
        middle = np.cumsum(w) - 0.5 * w
        found[k] = np.interp(0.5 * w.sum(), middle, values[order])
    return times, found


# ------------------------------------------------------------------------------------------------------------ draws


def quantile(values, share):
    """The value below which one more draw lies with this probability (Hyndman and Fan 1996, definition 6)."""
    values = np.sort(values)
    at = np.clip(share * (len(values) + 1) - 1, 0, len(values) - 1)
    return float(np.interp(at, np.arange(len(values)), values))


def interval(draws):
    """Quantiles at 5, 50 and 95 % of a parameter, taken of the logarithm of its magnitude."""
    sign = np.sign(draws[0])
    low, middle, high = (quantile(np.log(np.abs(draws)), share) for share in (0.05, 0.5, 0.95))
    ends = sorted(sign * np.exp([low, high]))
    return {"p5": ends[0], "p50": sign * np.exp(middle), "p95": ends[1]}, high - low


# ------------------------------------------------------------------------------------------------- the wall's motion


def volumes(x, tets):
    """Volumes of tetrahedra, mm3."""
    a, b, c, d = (x[tets[:, k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def edges(x, tets):
    """Lengths of the elements' edges: an edge counts once for each element that has it."""
    pairs = np.concatenate([tets[:, [a, b]] for a in range(4) for b in range(a + 1, 4)])
    return np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)


def openings(surface):
    """Edges of a surface that belong to one triangle alone."""
    edges = np.concatenate([surface[:, [0, 1]], surface[:, [1, 2]], surface[:, [2, 0]]])
    _, where, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    return edges[count[where.ravel()] == 1]


def cavity(x, endocardium):
    """Volume behind the endocardium, mL. A fan around the mean of its edge's nodes closes the opening."""
    edge = openings(endocardium)
    hub = x[np.unique(edge)].mean(axis=0)
    total = np.einsum("ij,ij->i", x[endocardium[:, 0]], np.cross(x[endocardium[:, 1]], x[endocardium[:, 2]])).sum()
    total += np.einsum("ij,ij->i", np.cross(x[edge[:, 1]], x[edge[:, 0]]), np.tile(hub, (len(edge), 1))).sum()
    return abs(total) / 6000


def left_wall(mesh):
    """Inner wall, whole outer wall and rim of the left ventricle: triangles of the mesh.

    The outer wall contains the septum. In a mesh of both ventricles it is the outside of tissue of tag 1: the
    epicardium's part, the septum's right side, and the faces where the right ventricle's wall joins.
    The rim is the part nearer to the left opening.
    """
    surfaces = mesh.surfaces
    inner, rim = surfaces["endocardium"], surfaces["rim"]
    if "right-ventricle" not in surfaces:
        parts = [surfaces[name] for name in ("epicardium", "septum") if name in surfaces]
        outer = np.concatenate(parts)
        _, first = np.unique(np.sort(outer, axis=1), axis=0, return_index=True)
        return inner, outer[np.sort(first)], rim
    middle = mesh.image[rim].mean(axis=1)
    far = [
        np.linalg.norm(middle[:, None] - mesh.image[np.unique(openings(surfaces[name]))][None], axis=2).min(axis=1)
        for name in ("endocardium", "right-ventricle")
    ]
    rim = rim[far[0] <= far[1]]
    # Faces of the left muscle towards the outside or towards the right ventricle's wall, less endocardium and base.
    faces = np.concatenate([mesh.tets[:, k] for k in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    tag = np.tile(mesh.tags, 4)
    key, where, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    where = where.ravel()
    beside = right_wall_tags(mesh)
    own = np.zeros(len(key), bool)
    own[where[tag == 1]] = True
    others = np.zeros(len(key), bool)
    others[where[np.isin(tag, beside)]] = True
    keys = {tuple(k): i for i, k in enumerate(key)}
    named = [keys[tuple(sorted(f))] for name in ("epicardium", "right-ventricle") for f in surfaces[name].tolist()]
    outside = np.zeros(len(key), bool)
    outside[named] = True
    left_of_right = np.zeros(len(key), bool)
    left_of_right[where[~np.isin(tag, beside)]] = True
    wanted = (outside & own & (count == 1)) | (left_of_right & others & (count == 2))
    return inner, key[wanted], rim


def right_wall_tags(mesh):
    """Tags of passive tissue that has no node at the left endocardium: the right ventricle's wall."""
    inner = np.unique(mesh.surfaces["endocardium"])
    return [t for t in np.unique(mesh.tags) if t != 1 and not np.isin(mesh.tets[mesh.tags == t], inner).any()]


def areas(x, surface):
    """Area of a surface that belongs to each of its nodes: nodes and areas."""
    a, b, c = (x[surface[:, k]] for k in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    weight = np.zeros(len(x))
    for k in range(3):
        np.add.at(weight, surface[:, k], third)
    nodes = np.flatnonzero(weight)
    return nodes, weight[nodes]


def mean(x, patch):
    nodes, weight = patch
    return weight @ x[nodes] / weight.sum()


class Wall:
    """What motion is measured on: the rim, both apices, and three levels of both walls (docs/mechanics.md)."""

    def __init__(self, x, inner, outer, rim):
        self.rim = areas(x, rim)
        base = mean(x, self.rim)
        self.apex, self.levels = [], []
        walls = [areas(x, inner), areas(x, outer)]
        for nodes, weight in walls:
            distance = np.linalg.norm(x[nodes] - base, axis=1)
            tip = distance >= 0.98 * distance.max()
            self.apex.append((nodes[tip], weight[tip]))
        apex = mean(x, self.apex[0])
        long = base - apex
        for nodes, weight in walls:
            height = (x[nodes] - apex) @ long / (long @ long)
            near = [weight * np.clip(1 - np.abs(height - level) / 0.125, 0, None) for level in (0.25, 0.5, 0.75)]
            self.levels.append([(nodes[w > 0], w[w > 0]) for w in near])

    def axis(self, x):
        long = mean(x, self.apex[0]) - mean(x, self.rim)
        return long / np.linalg.norm(long), np.linalg.norm(long)

    def shape(self, begin, x):
        """Base and epicardial apex along the axis at the beginning, cavity's length, both radii, both twists."""
        (first, _), (axis, length) = self.axis(begin), self.axis(x)
        radii = []
        for levels in self.levels:
            nodes, weight = levels[1]
            arm = across(x[nodes] - mean(x, levels[1]), axis)
            radii.append(weight @ np.linalg.norm(arm, axis=1) / weight.sum())
        twists = [
            turn(begin, first, x, axis, levels[0]) - turn(begin, first, x, axis, levels[2]) for levels in self.levels
        ]
        return np.array([mean(x, self.rim) @ first, mean(x, self.apex[1]) @ first, length, *radii, *twists])


def across(v, axis):
    return v - np.outer(v @ axis, axis)


def turn(begin, first, x, axis, patch):
    """Rotation of a patch around the axis, degrees; the axis is turned back to where it began."""
    nodes, weight = patch
    a = across(begin[nodes] - mean(begin, patch), first)
    b = across(x[nodes] - mean(x, patch), axis)
    k, c = np.cross(axis, first), axis @ first
    b = b + np.cross(k, b) + np.cross(k, np.cross(k, b)) / (1 + c)
    return np.degrees(np.arctan2(weight @ (np.cross(a, b) @ first), weight @ (a * b).sum(axis=1)))


def motion(mesh, frames, times, pressure):
    """The measures of a beat; `times` are t4, t5 and t6."""
    wall = Wall(mesh.image, *left_wall(mesh))
    begin = frames.x[0]
    shapes = np.array([wall.shape(begin, x) for x in frames.x])

    def at(time):
        return np.array([np.interp(time, frames.time, column) for column in shapes.T])

    start, systole = shapes[0], at(times["t5_ms"])
    peak = [shapes[np.abs(shapes[:, k]).argmax(), k] for k in (5, 6)]
    found = {
        "base_descent_mm": systole[0] - start[0],
        "apex_rise_mm": start[1] - systole[1],
        "epicardial_radius_change_percent": 100 * (systole[4] / start[4] - 1),
        "shortening_percent": 100 * (1 - systole[2] / start[2]),
        "wall_thickening_percent": 100 * ((systole[4] - systole[3]) / (start[4] - start[3]) - 1),
        "twist_endo_deg": peak[0],
        "twist_epi_deg": peak[1],
        "isovolumic_lengthening_percent": 100 * (at(times["t4_ms"])[2] / start[2] - 1),
        "least_pressure_mmHg": pressure.min(),
    }
    if times.get("t6_ms") is not None:
        found["isovolumic_untwisting_percent"] = 100 * (systole[6] - at(times["t6_ms"])[6]) / peak[1]
    ratios = np.array([volumes(x, mesh.tets) for x in frames.x]) / volumes(mesh.unloaded, mesh.tets)
    return found | {"least_volume_ratio": ratios.min(), "largest_volume_ratio": ratios.max()}
