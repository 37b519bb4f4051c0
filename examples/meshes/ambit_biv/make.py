#!/usr/bin/env python3
"""Makes this mesh of both ventricles from the one of Ambit in CARP text: tags walls and a ring at the base, gives surfaces their names.

    python3 make.py AMBIT_BIV/ambit_biv ambit_biv
"""

import sys

WALL_UM = 9000.0  # tissue nearer than this to the left cavity is the left ventricle's, the septum included
RING_UM = 6000.0  # of the left ventricle's wall, so much below the valve plane is a passive ring that its valves hang on
PLANE_UM, NORMAL = (14280.0, 10.0, 14830.0), (0.1305, 0.0, 0.9914)
NAMES = {"endo_lv": "endocardium", "endo_rv": "endo_rv", "epi": "epicardium", "base": "rim"}


def rows(file):
    with open(file) as lines:
        return [line.split() for line in lines][1:]


def mean(points):
    return [sum(c) / len(points) for c in zip(*points)]


def main(source, target):
    nodes = [[float(c) for c in row] for row in rows(f"{source}.pts")]
    tets = [[int(n) for n in row[1:5]] for row in rows(f"{source}.elem")]
    at = set()
    for row in rows(f"{source}.endo_lv.surf"):
        a, b, c = (nodes[int(n)] for n in row[1:4])
        at.update(map(tuple, (a, b, c, mean([a, b]), mean([b, c]), mean([c, a]), mean([a, b, c]))))

    def tag(tet):
        x, y, z = mean([nodes[n] for n in tet])
        if not any((x - p) ** 2 + (y - q) ** 2 + (z - r) ** 2 < WALL_UM**2 for p, q, r in at):
            return 2
        return 3 if sum((c - p) * n for c, p, n in zip((x, y, z), PLANE_UM, NORMAL)) > -RING_UM else 1

    with open(f"{target}.pts", "w") as out:
        out.write(f"{len(nodes)}\n" + "".join(f"{x:.0f} {y:.0f} {z:.0f}\n" for x, y, z in nodes))
    with open(f"{target}.elem", "w") as out:
        out.write(f"{len(tets)}\n")
        out.writelines(f"Tt {a} {b} {c} {d} {tag([a, b, c, d])}\n" for a, b, c, d in tets)
    for old, new in NAMES.items():
        triangles = rows(f"{source}.{old}.surf")
        with open(f"{target}.{new}.surf", "w") as out:
            out.write(f"{len(triangles)}\n" + "".join(" ".join(t[:4]) + "\n" for t in triangles))


main(*sys.argv[1:])
