#!/usr/bin/env python3
"""Checks this solver on the two ventricles of Land et al. 2015 (Proc R Soc A 471:20150641), on which cardiotwin's own is checked.

    check.py [EDGE_MM]

Problem 2: an ellipsoid, clamped at its base, inflated to 10 kPa. Problem 3: inflated to 15 kPa while fibres of -90° to 90° pull with
60 kPa (second Piola-Kirchhoff). Prints where the apex goes; exit code 1 if it is off by more than the tolerances.
These are those of 1,767 elements with flat sides, the default of 4 mm. The endocardial apex of problem 3 lies where all fibres meet.
"""
import sys

import numpy as np
from wall import MMHG, SLACK_STRETCH, Wall, fibres, meshed

AXES = (7.0, 17.0, 10.0, 20.0, 5.0)  # mm
PROBLEMS = {
    # law, C in kPa, angles, pressure and tension in kPa, apex in mm (endocardium, epicardium), tolerances in mm
    "inflation": ({"bf": 1.0, "bt": 1.0, "bfs": 1.0}, 10.0, (90.0, -90.0), 10.0, 0.0, (-26.612, -28.279), (0.2, 0.2)),
    "contraction": ({"bf": 8.0, "bt": 2.0, "bfs": 4.0}, 2.0, (90.0, -90.0), 15.0, 60.0, (-12.347, -15.452), (0.6, 0.2)),
}


def apex(wall, at_mm):
    """Where the point of the long axis at `at_mm` goes."""
    moved = wall.w.sub(0).collapse()
    places = moved.function_space.tabulate_dof_coordinates()
    nearest = np.argmin(np.linalg.norm(places - [at_mm, 0, 0], axis=1))
    return places[nearest, 0] + moved.x.array[3 * nearest]


def solved(problem, edge_mm):
    law, stiffness, angles, pressure, tension, *_ = problem
    heart = meshed(AXES, edge_mm)
    wall = Wall(heart, fibres(heart.mesh, AXES, angles), law, clamped=True)
    wall.stiffness.value = 1e3 * stiffness
    wall.bulk.value = 1e9  # incompressible
    wall.longest_mm = 0.5
    n_steps = 30 if tension == 0 else 40
    before = wall.w.x.array.copy()
    for k in range(1, n_steps + 1):
        share = k / n_steps
        # A guess along the last step.
        before, wall.w.x.array[:] = wall.w.x.array.copy(), 2 * wall.w.x.array - before
        wall.pressure.value = share * pressure * 1e3

        def cells(stretches):
            stretch = SLACK_STRETCH * stretches
            return share * tension * stretch**2, 2 * share * tension * stretch * SLACK_STRETCH

        wanted = share * pressure * 1e3 / MMHG
        wall.factored = False
        wall.equilibrium(cells, lambda p: -1e6 * (p - wanted))
    return wall


def main():
    edge_mm = float(sys.argv[1]) if len(sys.argv) > 1 else 4.0
    off = False
    for name, problem in PROBLEMS.items():
        wall = solved(problem, edge_mm)
        expected, tolerances = problem[5], problem[6]
        found = [apex(wall, -17.0), apex(wall, -20.0)]
        off |= any(abs(a - b) > c for a, b, c in zip(found, expected, tolerances))
        print(
            f"{name}: {wall.cells.size} elements, apex at {found[0]:.3f} and {found[1]:.3f} mm; Land et al. "
            f"{expected[0]} ± {tolerances[0]} and {expected[1]} ± {tolerances[1]} mm; cavity {wall.volume_ml():.4f} mL",
            flush=True,
        )
    sys.exit(1 if off else 0)


if __name__ == "__main__":
    main()
