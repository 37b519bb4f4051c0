"""Line plots as SVG, with the standard library alone: panels side by side, lines, bands, logarithmic axes."""

import math
from pathlib import Path

COLOURS = ("#1b5e9b", "#b3471d", "#3d7a36", "#7a3d7a", "#8a6d00", "#555555")


def line(label, points, colour=0, dash="", marks=False):
    return {"label": label, "points": points, "colour": COLOURS[colour % len(COLOURS)], "dash": dash, "marks": marks}


def ticks(low, high, log):
    """Round numbers between the ends; powers of ten, and 2 and 5 times them where there are few, on logarithmic axes."""
    if log:
        powers = range(math.floor(low), math.ceil(high) + 1)
        steps = (1,) if high - low > 2.5 else (1, 2, 5)
        every = [math.log10(m * 10.0**p) for p in powers for m in steps]
    else:
        step = 10.0 ** math.floor(math.log10((high - low) / 3))
        step *= next(m for m in (1, 2, 5, 10) if (high - low) / (step * m) <= 5)
        every = [step * k for k in range(math.floor(low / step), math.ceil(high / step) + 1)]
    span = high - low
    return [v for v in every if low - 1e-9 * span <= v <= high + 1e-9 * span]


def text_of(v, log):
    if log and v >= 3.0 - 1e-9:
        return f"{10**v:,.0f}"
    return f"{10**v:.3g}" if log else f"{0.0 if abs(v) < 1e-12 else v:.6g}"


def panel_svg(panel, left, right, top, bottom):
    logs = panel.get("log", (False, False))
    scale = [(lambda v: math.log10(max(v, 1e-300))) if log else (lambda v: v) for log in logs]
    put = lambda points: [(scale[0](x), scale[1](y)) for x, y in points]
    lines = [dict(one, points=put(one["points"])) for one in panel["lines"]]
    bands = [(colour, put(low), put(high)) for colour, low, high in panel.get("bands", [])]
    every = [p for one in lines for p in one["points"]] + [p for _, low, high in bands for p in low + high]
    x0, x1 = min(p[0] for p in every), max(p[0] for p in every)
    y0, y1 = min(p[1] for p in every), max(p[1] for p in every)
    y0, y1 = panel.get("y_range", (y0 - 0.04 * (y1 - y0 or 1), y1 + 0.04 * (y1 - y0 or 1)))
    if any(logs):
        x0, x1 = x0 - 0.05 * (x1 - x0), x1 + 0.05 * (x1 - x0)
    px = lambda x: left + (x - x0) / (x1 - x0 or 1) * (right - left)
    py = lambda y: bottom - (min(max(y, y0), y1) - y0) / (y1 - y0) * (bottom - top)
    path = lambda points: " ".join(f"{px(x):.1f},{py(y):.1f}" for x, y in points)
    middle = (left + right) / 2
    out = [f'<text x="{middle:.0f}" y="{top - 10}" text-anchor="middle" font-weight="bold">{panel["title"]}</text>']
    for v in ticks(x0, x1, logs[0]):
        out.append(f'<line x1="{px(v):.1f}" y1="{top}" x2="{px(v):.1f}" y2="{bottom}" stroke="#e4e4e4"/>')
        out.append(f'<text x="{px(v):.1f}" y="{bottom + 15}" text-anchor="middle">{text_of(v, logs[0])}</text>')
    for v in ticks(y0, y1, logs[1]):
        out.append(f'<line x1="{left}" y1="{py(v):.1f}" x2="{right}" y2="{py(v):.1f}" stroke="#e4e4e4"/>')
        out.append(f'<text x="{left - 5}" y="{py(v) + 4:.1f}" text-anchor="end">{text_of(v, logs[1])}</text>')
    out.append(f'<rect x="{left}" y="{top}" width="{right - left}" height="{bottom - top}" fill="none" stroke="#888"/>')
    out.append(f'<text x="{middle:.0f}" y="{bottom + 32}" text-anchor="middle">{panel["x"]}</text>')
    turned = f"translate({left - 44:.0f} {(top + bottom) / 2:.0f}) rotate(-90)"
    out.append(f'<text transform="{turned}" text-anchor="middle">{panel["y"]}</text>')
    for colour, low, high in bands:
        out.append(f'<polygon points="{path(low + high[::-1])}" fill="{colour}" opacity="0.2"/>')
    for one in lines:
        style = f'fill="none" stroke="{one["colour"]}" stroke-width="1.6" stroke-dasharray="{one["dash"]}"'
        out.append(f'<polyline points="{path(one["points"])}" {style}/>')
        if one["marks"]:
            out += [f'<circle cx="{px(x):.1f}" cy="{py(y):.1f}" r="2.6" fill="{one["colour"]}"/>' for x, y in one["points"]]
    return out


def draw(path, panels, width=900, height=310):
    """Each panel: title, x, y (names of axes), lines, and perhaps bands (colour, low, high), log (x, y), y_range."""
    legend = {}
    for panel in panels:
        for one in panel["lines"]:
            if one["label"]:
                legend.setdefault((one["label"], one["colour"], one["dash"]), None)
    rows, place = [[]], 60
    for label, colour, dash in legend:
        size = 40 + 6.4 * len(label)
        if place + size > width:
            rows.append([])
            place = 60
        rows[-1].append((place, label, colour, dash))
        place += size
    total = height + 18 * len(rows)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {total}" font-family="sans-serif" font-size="11">',
        f'<rect width="{width}" height="{total}" fill="white"/>',
    ]
    w = width / len(panels)
    for k, panel in enumerate(panels):
        out += panel_svg(panel, round(k * w + 58), round((k + 1) * w - 14), 28, height - 40)
    for r, row in enumerate(rows):
        y = height + 8 + 18 * r
        for x, label, colour, dash in row:
            out.append(
                f'<line x1="{x}" y1="{y - 4}" x2="{x + 24}" y2="{y - 4}" stroke="{colour}" stroke-width="1.6" '
                f'stroke-dasharray="{dash}"/>'
            )
            out.append(f'<text x="{x + 29}" y="{y}">{label}</text>')
    out.append("</svg>\n")
    Path(path).write_text("\n".join(out))
