#!/usr/bin/env python3
"""The same ventricle under cardiotwin's mechanics and under dolfinx with PETSc: seconds a time step, side by side.

    sudo apt install --no-install-recommends python3-dolfinx python3-gmsh        # Debian 12: dolfinx 0.5.2, PETSc 3.18
    cargo build --release --manifest-path dev/Cargo.toml
    /usr/bin/python3 deploy/beside-dolfinx.py [--nodes 8000] [--steps 40] [--repeats 3] [--json]

A truncated ellipsoid is meshed by gmsh. Both programs read the same nodes, tetrahedra and fibres (±60° through the wall), and solve the
same equations: linear displacement with one integration point, Guccione's law, kappa/2 (ln J)^2, active stress along the fibre, a pressure
that follows the endocardium, springs on epicardium and base, lumped mass, and generalised-alpha steps of 1 ms with a spectral radius of 0.
Pressure and active stress rise from zero within 40 ms. Newton's method starts from the same prediction and ends at the same residual, 1e-4 of the
load's forces; the linear tolerance follows from the residual by the same rule. Each runs in one process on one core. Compilation, meshes
and cardiotwin's start are not counted. The nodes' displacements at the end must agree, or the script fails.

dolfinx is run with conjugate gradients (GMRES where they end with an indefinite matrix or preconditioner) and PETSc's block Jacobi
(pbjacobi), and with its algebraic multigrid (GAMG, with rigid motions).
cardiotwin is run with this element, and with the element, the tolerance and the linear solver of a cohort (--as-cohort), which resists
changes of volume by nodal averages: another element than dolfinx's, without a counterpart there.
"""

import argparse
import csv
import json
import logging
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

C_KPA, B_F, B_T, B_FS = 2.0, 18.48, 3.58, 1.627
KAPPA_KPA, DENSITY = 650.0, 1.06  # kPa, mg/mm³
EPICARDIUM, BASE = 0.5, 10.0  # kPa/mm
PRESSURE_KPA, ACTIVE_KPA, RISE_MS = 8.0, 40.0, 40  # reached after so many steps
INNER, OUTER, RIM = (25.0, 60.0), (35.0, 70.0), 20.0  # half-axes and height of the rim, mm
TOLERANCE, LOOSEST, SHARE, LEAST_KPA = 1e-4, 0.1, 0.3, 0.5


def level(x, axes):
    return (x[..., 0] ** 2 + x[..., 1] ** 2) / axes[0] ** 2 + x[..., 2] ** 2 / axes[1] ** 2


def fibres_at(x):
    """Unit vectors (n, 3) that turn from +60° at the endocardium to -60° at the epicardium."""
    inner, outer = np.sqrt(level(x, INNER)), np.sqrt(level(x, OUTER))
    depth = (inner - 1) / (inner - outer)
    normal = x / np.array([INNER[0] ** 2, INNER[0] ** 2, INNER[1] ** 2])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    around = np.cross([0.0, 0.0, 1.0], x)
    around /= np.maximum(np.linalg.norm(around, axis=1), 1e-9)[:, None]
    angle = np.radians(60 - 120 * np.clip(depth, 0, 1))[:, None]
    fibres = np.cos(angle) * around + np.sin(angle) * np.cross(normal, around)
    return fibres / np.linalg.norm(fibres, axis=1)[:, None]


def mesh(nodes: int):
    """Nodes (n, 3) in mm, tetrahedra (e, 4), triangles of each surface, fibres (e, 3)."""
    import gmsh

    wall = math.pi * 4 / 3 * (OUTER[0] ** 2 * OUTER[1] - INNER[0] ** 2 * INNER[1]) * 0.64
    size = (wall / nodes * 1.1) ** (1 / 3)
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    bodies = []
    for short, long in (OUTER, INNER):
        ball = occ.addSphere(0, 0, 0, 1)
        occ.dilate([(3, ball)], 0, 0, 0, short, short, long)
        bodies.append((3, ball))
    shell, _ = occ.cut(bodies[:1], bodies[1:])
    box = occ.addBox(-100, -100, RIM, 200, 200, 200)
    occ.cut(shell, [(3, box)])
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.model.mesh.generate(3)
    tags, points, _ = gmsh.model.mesh.getNodes()
    points = points.reshape(-1, 3)
    place = {tag: k for k, tag in enumerate(tags)}
    local = np.vectorize(place.__getitem__)
    tets = local(gmsh.model.mesh.getElementsByType(4)[1]).reshape(-1, 4)
    triangles = local(gmsh.model.mesh.getElementsByType(2)[1]).reshape(-1, 3)
    gmsh.finalize()
    used = np.unique(tets)
    renumbered = np.full(len(points), -1)
    renumbered[used] = np.arange(len(used))
    points, tets, triangles = points[used], renumbered[tets], renumbered[triangles]
    edges = points[tets[:, 1:]] - points[tets[:, :1]]
    turned = np.linalg.det(edges) < 0
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]

    corners = points[triangles]
    on = {
        "base": np.all(np.abs(corners[..., 2] - RIM) < 1e-6, axis=1),
        "endo": np.all(np.abs(level(corners, INNER) - 1) < 1e-3, axis=1),
        "epi": np.all(np.abs(level(corners, OUTER) - 1) < 1e-3, axis=1),
    }
    surfaces = {name: triangles[which] for name, which in on.items()}
    assert sum(len(t) for t in surfaces.values()) == len(triangles)
    # The area vectors point out of the wall.
    behind = {frozenset(f): e for e, tet in enumerate(tets) for f in (tet[[0, 1, 2]], tet[[0, 1, 3]], tet[[0, 2, 3]], tet[[1, 2, 3]])}
    for name, facets in surfaces.items():
        for f in facets:
            inside = points[tets[behind[frozenset(f)]]].mean(axis=0)
            normal = np.cross(points[f[1]] - points[f[0]], points[f[2]] - points[f[0]])
            if normal @ (points[f].mean(axis=0) - inside) < 0:
                f[[1, 2]] = f[[2, 1]]
    return points, tets, surfaces, fibres_at(points[tets].mean(axis=1))


def course(peak: float) -> str:
    return f'kind = "ramp"\nvalue_kPa = {peak}\nuntil_s = {RISE_MS * 1e-3}'


def write_case(folder: Path, made, steps: int, probes) -> list[Path]:
    """A CARP mesh and benchmark files for `cardiotwin-dev mechanics-case`: all steps, and the first one alone."""
    points, tets, surfaces, fibres = made
    with open(folder / "lv.pts", "w") as to:
        to.write(f"{len(points)}\n")
        to.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    with open(folder / "lv.elem", "w") as to:
        to.write(f"{len(tets)}\n")
        to.writelines(f"Tt {a} {b} {c} {d} 1\n" for a, b, c, d in tets)
    with open(folder / "lv.lon", "w") as to:
        to.write("1\n")
        to.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in fibres.tolist())
    for name, facets in surfaces.items():
        with open(folder / f"lv.{name}.surf", "w") as to:
            to.write(f"{len(facets)}\n")
            to.writelines(f"Tr {a} {b} {c}\n" for a, b, c in facets)
    probe = "".join(f'\n[[probe]]\nname = "p{k}"\nat_mm = {points[node].tolist()}\n' for k, node in enumerate(probes))
    text = f"""title = "beside dolfinx"
[mesh]
file = "lv"
unit = "mm"
[element]
degree = "linear"
volume = "pointwise"
[[tissue]]
density_mg_per_mm3 = {DENSITY}
passive = {{ law = "guccione", c_kPa = {C_KPA}, b_f = {B_F}, b_t = {B_T}, b_fs = {B_FS} }}
volumetric = {{ law = "ln-squared", kappa_kPa = {KAPPA_KPA} }}
active = {{ convention = "second-piola" }}
[fibres]
rule = "from-mesh"
[[support]]
surface = "epi"
direction = "normal"
spring_kPa_per_mm = {EPICARDIUM}
[[support]]
surface = "base"
direction = "all"
spring_kPa_per_mm = {BASE}
[active_stress]
{course(ACTIVE_KPA)}
[[pressure]]
surface = "endo"
[pressure.course]
{course(PRESSURE_KPA)}
[time]
mode = "dynamic"
dt_ms = 1.0
end_ms = {steps}.0
output_every_ms = {steps}.0
alpha_m = -1.0
alpha_f = 0.0
[solver]
relative_tolerance = {TOLERANCE}
least_pressure_kPa = {LEAST_KPA}
linear = "rigid-levels"
{probe}"""
    cases = [folder / "all.toml", folder / "first.toml"]
    cases[0].write_text(text)
    cases[1].write_text(re.sub(r"(end|output_every)_ms = .*", r"\1_ms = 1.0", text))
    return cases


def computed(program: Path, case: Path, *options: str):
    """Steps, Newton and linear iterations, seconds; and the probes' displacements at the end."""
    table = case.with_suffix(".csv")
    environment = dict(os.environ, OMP_NUM_THREADS="1")
    done = subprocess.run(
        [program, "mechanics-case", case, "--out", table, *options], env=environment, capture_output=True, text=True
    )
    if done.returncode != 0:
        sys.exit(f"{program}: {done.stderr}")
    found = re.search(r"(\d+) steps .*?(\d+) Newton and (\d+) linear iterations.* ([\d.]+) s", done.stderr)
    if not found:
        sys.exit(f"{program}: no summary in {done.stderr!r}")
    with open(table) as rows:
        heads, *values = csv.reader(rows)
    ends = np.array([float(v) for h, v in zip(heads, values[-1]) if h.endswith("_mm")]).reshape(-1, 3)
    return np.array([float(found[k]) for k in (1, 2, 3, 4)]), ends


def cardiotwin(program: Path, cases: list[Path], *options: str):
    """Cost of a step after the first one, which pays for reading the mesh; and the probes' displacements at the end."""
    (whole, ends), (first, _) = (computed(program, case, *options) for case in cases)
    steps, newton, linear, seconds = whole - first
    return {"s_per_step": seconds / steps, "newton_per_step": newton / steps, "linear_per_newton": linear / newton}, ends


class Peer:
    """dolfinx's ventricle."""

    def __init__(self, made, steps: int):
        import dolfinx
        import ufl
        from dolfinx import fem
        from mpi4py import MPI

        logging.disable(logging.INFO)  # command lines of compilers
        points, tets, surfaces, _ = made
        self.steps = steps
        element = ufl.VectorElement("Lagrange", ufl.tetrahedron, 1)
        self.mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, tets, points, ufl.Mesh(element))
        space = self.space = fem.VectorFunctionSpace(self.mesh, ("Lagrange", 1))
        # dolfinx numbers the mesh's nodes and the unknowns anew, each in its own way.
        vertex_of = {int(old): new for new, old in enumerate(self.mesh.geometry.input_global_indices)}
        self.places = space.tabulate_dof_coordinates()
        number = {tuple(x): k for k, x in enumerate(points.round(6))}
        self.node_of = np.array([number[tuple(x)] for x in self.places.round(6)])
        fibre = fem.Function(fem.VectorFunctionSpace(self.mesh, ("DG", 0)))
        fibre.interpolate(lambda x: fibres_at(x.T).T)
        self.mesh.topology.create_connectivity(2, 0)
        self.mesh.topology.create_connectivity(2, 3)
        facets = dolfinx.mesh.exterior_facet_indices(self.mesh.topology)
        corners = dolfinx.cpp.mesh.entities_to_geometry(self.mesh._mesh, 2, facets, False)
        number = {frozenset(map(int, c)): f for c, f in zip(corners, facets)}
        marks = {}
        for mark, name in enumerate(("endo", "epi", "base"), start=1):
            for facet in surfaces[name]:
                marks[number[frozenset(vertex_of[int(v)] for v in facet)]] = mark
        order = np.array(sorted(marks), dtype=np.int32)
        tags = dolfinx.mesh.meshtags(self.mesh, 2, order, np.array([marks[f] for f in order], dtype=np.int32))

        self.u, self.v, self.a = (fem.Function(space) for _ in range(3))
        self.end = fem.Function(space)
        self.pressure, self.active = (fem.Constant(self.mesh, 0.0) for _ in range(2))
        u, w, dt = self.end, ufl.TestFunction(space), 1.0
        a_end = (u - self.u - dt * self.v) / dt**2 + 0.5 * self.a
        identity = ufl.Identity(3)
        f = ufl.variable(identity + ufl.grad(u))
        j = ufl.det(f)
        e = ufl.variable(0.5 * (f.T * f - identity))
        c = 2 * e + identity
        iso = 0.5 * (ufl.det(c) ** (-1 / 3) * c - identity)
        along = ufl.dot(iso, fibre)
        ff = ufl.dot(fibre, along)
        q = B_F * ff**2 + B_T * (ufl.inner(iso, iso) - 2 * ufl.dot(along, along) + ff**2) + 2 * B_FS * (ufl.dot(along, along) - ff**2)
        energy = 0.5 * C_KPA * (ufl.exp(q) - 1) + 0.5 * KAPPA_KPA * (0.5 * ufl.ln(ufl.det(c))) ** 2
        # Q is written with products that are not symmetric in the components of e.
        stress = ufl.sym(ufl.diff(energy, e)) + self.active * ufl.outer(fibre, fibre)
        inside = ufl.dx(self.mesh, metadata={"quadrature_degree": 0})
        lumped = ufl.dx(self.mesh, metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
        on = ufl.ds(self.mesh, subdomain_data=tags, metadata={"quadrature_degree": 2})
        n = ufl.FacetNormal(self.mesh)
        load = self.pressure * ufl.inner(j * ufl.inv(f).T * n, w) * on(1)
        residual = (
            DENSITY * ufl.inner(2 * a_end - self.a, w) * lumped
            + ufl.inner(f * stress, ufl.grad(w)) * inside
            + EPICARDIUM * ufl.dot(u, n) * ufl.dot(w, n) * on(2)
            + BASE * ufl.inner(u, w) * on(3)
            + load
        )
        fast = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"], "cffi_libraries": ["m"]}
        self.residual = fem.form(residual, jit_params=fast)
        self.load = fem.form(load, jit_params=fast)
        self.tangent = fem.form(ufl.derivative(residual, u), jit_params=fast)
        self.matrix = fem.petsc.create_matrix(self.tangent)
        self.r, self.loads = (fem.petsc.create_vector(self.residual) for _ in range(2))

    def solver(self, kind: str, by: str = "cg"):
        from petsc4py import PETSc

        ksp = PETSc.KSP().create(self.mesh.comm)
        ksp.setType(by)
        if by == "gmres":
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.getPC().setType({"block Jacobi": "pbjacobi", "GAMG": "gamg"}[kind])
        self.matrix.setBlockSize(3)
        if kind == "GAMG":
            points = PETSc.Vec().createWithArray(self.places.ravel().copy(), bsize=3, comm=self.mesh.comm)
            self.matrix.setNearNullSpace(PETSc.NullSpace().createRigidBody(points))
            PETSc.Options()["pc_gamg_reuse_interpolation"] = "true"
        ksp.setFromOptions()
        ksp.setOperators(self.matrix)
        return ksp

    def assembled(self, form, to) -> float:
        from dolfinx import fem

        with to.localForm() as local:
            local.set(0.0)
        fem.petsc.assemble_vector(to, form)
        return to.norm()

    def run(self, kind: str, probes):
        from dolfinx import fem

        for state in (self.u, self.v, self.a, self.end):
            state.x.array[:] = 0.0
        ksp, x = self.solver(kind), self.r.duplicate()
        second = self.solver(kind, by="gmres")
        newton = linear = by_gmres = 0
        began = time.perf_counter()
        for step in range(1, self.steps + 1):
            u, v, a = (state.x.array.copy() for state in (self.u, self.v, self.a))
            risen = min(step / RISE_MS, 1.0)
            self.pressure.value, self.active.value = PRESSURE_KPA * risen, ACTIVE_KPA * risen
            self.end.x.array[:] = u + v + 0.5 * a
            for iteration in range(20):
                norm = self.assembled(self.residual, self.r)
                scale = self.assembled(self.load, self.loads) * max(LEAST_KPA / self.pressure.value, 1.0)
                if norm <= TOLERANCE * scale:
                    break
                self.matrix.zeroEntries()
                fem.petsc.assemble_matrix(self.matrix, self.tangent)
                self.matrix.assemble()
                ksp.setTolerances(rtol=min(max(SHARE * TOLERANCE * scale / norm, 1e-10), LOOSEST), max_it=2000)
                ksp.setOperators(self.matrix)
                ksp.solve(self.r, x)
                linear += ksp.getIterationNumber()
                if ksp.getConvergedReason() < 0:
                    # Conjugate gradients call the matrix or its preconditioner indefinite.
                    second.setTolerances(rtol=ksp.getTolerances()[0], max_it=2000)
                    second.setOperators(self.matrix)
                    second.solve(self.r, x)
                    linear += second.getIterationNumber()
                    by_gmres += 1
                    if second.getConvergedReason() < 0:
                        sys.exit(f"dolfinx, {kind}: PETSc ends with reason {second.getConvergedReason()}")
                self.end.x.array[:] -= x.array
                newton += 1
            else:
                sys.exit(f"dolfinx, {kind}: Newton's method does not converge in step {step}")
            a_end = self.end.x.array - u - v + 0.5 * a
            self.v.x.array[:] = v - 0.5 * a + 1.5 * a_end
            self.a.x.array[:], self.u.x.array[:] = a_end, self.end.x.array
        seconds = time.perf_counter() - began
        moved = np.empty((len(self.node_of), 3))
        moved[self.node_of] = self.u.x.array.reshape(-1, 3)
        return {
            "s_per_step": seconds / self.steps,
            "newton_per_step": newton / self.steps,
            "linear_per_newton": linear / max(newton, 1),
            "by_gmres": by_gmres / max(newton, 1),
        }, moved[probes]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, default=8000, help="about so many nodes")
    parser.add_argument("--steps", type=int, default=40, help="steps of 1 ms")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, of which the median counts")
    parser.add_argument("--cardiotwin-dev", type=Path, default=Path("target/release/cardiotwin-dev"))
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        import dolfinx  # noqa: F401
        import gmsh  # noqa: F401
    except ImportError as error:
        sys.exit(f"{error}: sudo apt install --no-install-recommends python3-dolfinx python3-gmsh, and run by /usr/bin/python3")
    made = mesh(arguments.nodes)
    points, tets = made[0], made[1]
    # The lowest node, and two of the rim.
    probes = [int(points[:, 2].argmin()), int(points[:, 0].argmax()), int(points[:, 1].argmin())]
    results: dict[str, list] = {}
    ends = {}
    with tempfile.TemporaryDirectory() as folder:
        cases = write_case(Path(folder), made, arguments.steps, probes)
        peer = Peer(made, arguments.steps)
        for _ in range(arguments.repeats):
            for name, run in (
                ("cardiotwin, dolfinx's element", lambda: cardiotwin(arguments.cardiotwin_dev, cases)),
                ("cardiotwin, a cohort's element", lambda: cardiotwin(arguments.cardiotwin_dev, cases, "--as-cohort")),
                ("dolfinx, block Jacobi", lambda: peer.run("block Jacobi", probes)),
                ("dolfinx, GAMG", lambda: peer.run("GAMG", probes)),
            ):
                figures, ends[name] = run()
                results.setdefault(name, []).append(figures)
                print(f"{name}: {figures['s_per_step']:.3f} s a step", file=sys.stderr, flush=True)
    base = ends["dolfinx, block Jacobi"]
    largest = float(np.linalg.norm(base, axis=1).max())
    table = []
    for name, runs in results.items():
        medians = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
        spread = max(run["s_per_step"] for run in runs) / min(run["s_per_step"] for run in runs)
        apart = float(np.linalg.norm(ends[name] - base, axis=1).max()) / largest
        table.append({"name": name, **medians, "slowest_over_fastest": spread, "apart": apart})
    own = table[0]["s_per_step"]
    for row in table:
        row["over_cardiotwin"] = row["s_per_step"] / own
    if arguments.json:
        print(json.dumps({"nodes": len(points), "tetrahedra": len(tets), "steps": arguments.steps, "results": table}, indent=2))
    else:
        print(f"{len(points)} nodes, {len(tets)} tetrahedra, {arguments.steps} steps of 1 ms, one core, medians of {arguments.repeats}")
        print("| | s a step | times cardiotwin's | Newton a step | linear a Newton | slowest over fastest | displacement apart |")
        print("|---|---|---|---|---|---|---|")
        for r in table:
            print(
                f"| {r['name']} | {r['s_per_step']:.3f} | {r['over_cardiotwin']:.1f} | {r['newton_per_step']:.2f} | "
                f"{r['linear_per_newton']:.1f} | {r['slowest_over_fastest']:.2f} | {100 * r['apart']:.3f} % |"
            )
    if table[0]["apart"] > 5e-3:
        sys.exit("the same equations have different solutions: one of the two programs is wrong")


if __name__ == "__main__":
    main()
