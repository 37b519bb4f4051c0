"""A left ventricle of finite elements in FEniCSx: mesh of cardiac-geometries, material of fenicsx-pulse.

The wall is a truncated ellipsoid, incompressible, of quadratic tetrahedra with a linear pressure (Taylor-Hood). Each step solves
for displacement, wall pressure and cavity pressure together: the wall is in equilibrium, and the cavity holds the volume that the
circulation leaves in it. Lengths in mm, stresses in Pa (fenicsx-pulse's own unit), volumes in mL, pressures of the cavity in mmHg.
"""
import math
import tempfile
from pathlib import Path

import basix
import basix.ufl
import cardiac_geometries_core
import dolfinx
import dolfinx.fem.petsc
import gmsh
import numpy as np
import pulse
import ufl
from mpi4py import MPI
from petsc4py import PETSc

try:
    from dolfinx.io import gmshio
except ImportError:  # from dolfinx 0.10 on
    from dolfinx.io import gmsh as gmshio

MMHG = 133.322387415  # Pa
SLACK_STRETCH = 1.08  # of the unloaded wall's cells, as cardiotwin's solver.slack_stretch
EXPONENTS = {"bf": 18.48, "bt": 3.58, "bfs": 1.627}  # Guccione et al. 1995
BULK = 1e6  # Pa, resists a change of volume
VISCOSITY = 2e4  # Pa ms; keeps the relaxed wall from buckling where it is smaller than unloaded
BASE_SPRING = 1e3  # Pa/mm, holds the base against sliding in its plane
DEGREE = 4  # of the quadrature
LONGEST_MM = 6.0  # way of a node in an iteration
LONG_AXIS = 17 / 7  # of the unloaded cavity over its short half-axis, as in Land et al. 2015
BASE_LEVEL = 5 / 17  # of the base plane above the equator, over the cavity's long half-axis


class Diverged(Exception):
    pass


def ellipsoid(cavity_ml, wall_ml):
    """Half-axes in mm of endocardium and epicardium (short, long), and the base plane."""

    def volume(short, long, base):  # of a truncated ellipsoid from its apex to the base, mm3
        return math.pi * short**2 * (base + long - (base**3 + long**3) / (3 * long**2))

    short = (1e3 * cavity_ml / volume(1.0, LONG_AXIS, BASE_LEVEL * LONG_AXIS)) ** (1 / 3)
    long = LONG_AXIS * short
    base = BASE_LEVEL * long
    thin, thick = 0.0, 3 * short
    for _ in range(60):
        middle = 0.5 * (thin + thick)
        if volume(short + middle, long + middle, base) < 1e3 * (cavity_ml + wall_ml):
            thin = middle
        else:
            thick = middle
    return short, long, short + thin, long + thin, base


def generated(cavity_ml, wall_ml, size):
    """Heart whose mesh, not only the ellipsoid, has the wanted volumes. `size`: edge over the wall's thickness."""
    wanted = np.array([cavity_ml, wall_ml])
    asked = wanted.copy()
    for _ in range(4):
        axes = ellipsoid(*asked)
        heart = meshed(axes, size * (axes[2] - axes[0]))
        found = np.array([heart.volume("ENDO"), scalar(dolfinx.fem.Constant(heart.mesh, 1.0) * heart.dx)]) / 1e3
        if np.all(np.abs(found / wanted - 1) < 2e-3):
            break
        asked *= wanted / found
    return heart, axes


def meshed(axes, edge_mm):
    """Mesh of a truncated ellipsoid along x, its apex at the negative end."""
    short, long, short_epi, long_epi, base = axes
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "lv.msh")
        cardiac_geometries_core.lv_ellipsoid(
            mesh_name=file,
            r_short_endo=short,
            r_long_endo=long,
            r_short_epi=short_epi,
            r_long_epi=long_epi,
            mu_base_endo=-math.acos(base / long),
            mu_base_epi=-math.acos(base / long_epi),
            psize_ref=edge_mm,
            verbose=False,
        )
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(file)
        mesh, _, facets = gmshio.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0)[:3]
        groups = gmsh.model.getPhysicalGroups()
        markers = {gmsh.model.getPhysicalName(*group): (group[1], group[0]) for group in groups}
        gmsh.finalize()
    return pulse.HeartGeometry(
        mesh=mesh, facet_tags=facets, markers=markers, metadata={"quadrature_degree": DEGREE}
    )


def depths(places, axes):
    """Depth of places in the wall, 0 at the endocardium and 1 at the epicardium."""
    short, long, short_epi, long_epi, _ = axes
    x, radius = places[:, 0], np.hypot(places[:, 1], places[:, 2])
    low, high = np.zeros(x.size), np.ones(x.size)
    for _ in range(40):
        depth = 0.5 * (low + high)
        beyond = np.hypot(x / (long + (long_epi - long) * depth), radius / (short + (short_epi - short) * depth)) > 1
        low, high = np.where(beyond, depth, low), np.where(beyond, high, depth)
    return 0.5 * (low + high)


def fibres(mesh, axes, angles=(60.0, -60.0)):
    """Fibre, sheet and normal at the quadrature points. A positive angle is a right-handed helix."""
    element = basix.ufl.quadrature_element(mesh.basix_cell(), value_shape=(3,), degree=DEGREE)
    space = dolfinx.fem.functionspace(mesh, element)
    places = space.tabulate_dof_coordinates()
    short, long, short_epi, long_epi, _ = axes
    depth = depths(places, axes)
    angle = np.radians(angles[0] + (angles[1] - angles[0]) * depth)
    theta = np.arctan2(places[:, 2], places[:, 1])
    mu = np.arctan2(
        np.hypot(places[:, 1], places[:, 2]) / (short + (short_epi - short) * depth),
        places[:, 0] / (long + (long_epi - long) * depth),
    )
    up = np.array(
        [
            (long + (long_epi - long) * depth) * np.sin(mu),
            -(short + (short_epi - short) * depth) * np.cos(mu) * np.cos(theta),
            -(short + (short_epi - short) * depth) * np.cos(mu) * np.sin(theta),
        ]
    )
    up /= np.linalg.norm(up, axis=0)
    around = np.array([np.zeros_like(theta), -np.sin(theta), np.cos(theta)])
    normal = np.cross(up, around, axis=0)
    fibre = np.sin(angle) * up + np.cos(angle) * around
    found = []
    for direction in (fibre, np.cross(fibre, normal, axis=0), normal):
        function = dolfinx.fem.Function(space)
        function.x.array[:] = direction.T.reshape(-1)
        found.append(function)
    return found


def scalar(form):
    return dolfinx.fem.assemble_scalar(dolfinx.fem.form(form))


class Wall:
    def __init__(self, heart, fibres, exponents=EXPONENTS, clamped=False):
        self.heart, mesh = heart, heart.mesh
        cell = mesh.basix_cell()
        element = basix.ufl.mixed_element(
            [basix.ufl.element("P", cell, 2, shape=(3,)), basix.ufl.element("P", cell, 1)]
        )
        space = dolfinx.fem.functionspace(mesh, element)
        self.w = dolfinx.fem.Function(space)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        u, p = ufl.split(self.w)
        v, _ = ufl.split(test)
        self.stiffness = dolfinx.fem.Constant(mesh, 1.0)  # Pa
        self.bulk = dolfinx.fem.Constant(mesh, BULK)
        self.pressure = dolfinx.fem.Constant(mesh, 0.0)  # Pa
        f0, s0, n0 = fibres
        material = pulse.Guccione(
            f0=f0, s0=s0, n0=n0, C=pulse.Variable(self.stiffness, "Pa"),
            **{name: pulse.Variable(dolfinx.fem.Constant(mesh, value), "dimensionless") for name, value in exponents.items()},
        )
        deformation = ufl.Identity(3) + ufl.grad(u)
        right = deformation.T * deformation
        stretch = ufl.sqrt(ufl.inner(f0, right * f0))
        # Active Cauchy stress along the fibre. Its values belong to the cells; the tangent knows their slope.
        values = basix.ufl.quadrature_element(cell, degree=DEGREE)
        of_points = dolfinx.fem.functionspace(mesh, values)
        self.active, self.slope = dolfinx.fem.Function(of_points), dolfinx.fem.Function(of_points)
        self.points = of_points.dofmap.list
        along = ufl.outer(deformation * f0, f0) / stretch**2
        cavity = heart.volume_form(u=u, marker="ENDO") * heart.ds(heart.markers["ENDO"][0])
        base = heart.ds(heart.markers["BASE"][0])
        # Isochoric strains, as in cardiotwin, and a wall that is nearly incompressible.
        energy = material.strain_energy(pulse.kinematics.Cdev(right))
        energy += p * (ufl.det(deformation) - 1) - p**2 / (2 * self.bulk)
        residual = ufl.derivative(energy * heart.dx, self.w, test)
        residual += ufl.inner(self.active * along, ufl.grad(v)) * heart.dx
        residual -= self.pressure * ufl.derivative(cavity, self.w, test)
        if not clamped:
            residual += BASE_SPRING * (u[1] * v[1] + u[2] * v[2]) * base
        # Viscous stress by the rate of Green's strain over the step; without a rate in statics.
        self.before = dolfinx.fem.Function(space)
        self.viscosity = dolfinx.fem.Constant(mesh, 0.0)  # over the step, Pa
        earlier = ufl.Identity(3) + ufl.grad(ufl.split(self.before)[0])
        strain = 0.5 * (right - earlier.T * earlier)
        residual += self.viscosity * ufl.inner(deformation * strain, ufl.grad(v)) * heart.dx
        tangent = ufl.derivative(residual, self.w, trial)
        tangent += ufl.inner(self.slope * ufl.derivative(stretch, self.w, trial) * along, ufl.grad(v)) * heart.dx
        options = {"cffi_extra_compile_args": ["-O2"]}
        form = lambda what: dolfinx.fem.form(what, jit_options=options)
        self.residual, self.tangent, self.volume = form(residual), form(tangent), form(cavity)
        self.gradient = form(ufl.derivative(cavity, self.w, test))
        rule, weights = basix.make_quadrature(basix.CellType.tetrahedron, DEGREE)
        self.stretch_of = dolfinx.fem.Expression(stretch, rule, jit_options=options)
        self.cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        share = weights / weights.sum()
        self.mean = lambda at_points: at_points.reshape(self.cells.size, -1) @ share
        corners = mesh.geometry.x[mesh.geometry.dofmap]
        edges = corners[:, 1:] - corners[:, :1]
        self.cell_volumes = np.abs(np.linalg.det(edges)) / 6
        self.middles = corners.mean(axis=1)
        # The base stays in its plane.
        facets = heart.facet_tags.find(heart.markers["BASE"][0])
        zero = dolfinx.default_scalar_type(0)
        if clamped:
            moves, _ = space.sub(0).collapse()
            still = dolfinx.fem.Function(moves)
            dofs = dolfinx.fem.locate_dofs_topological((space.sub(0), moves), 2, facets)
            self.fixed = [dolfinx.fem.dirichletbc(still, dofs, space.sub(0))]
        else:
            dofs = dolfinx.fem.locate_dofs_topological(space.sub(0).sub(0), 2, facets)
            self.fixed = [dolfinx.fem.dirichletbc(zero, dofs, space.sub(0).sub(0))]
        self.dofs = np.unique(np.concatenate([condition.dof_indices()[0] for condition in self.fixed]))
        self.moves, self.wall_pressures = (np.array(space.sub(k).collapse()[1]) for k in (0, 1))
        self.matrix = dolfinx.fem.petsc.create_matrix(self.tangent)
        self.solver = PETSc.KSP().create(MPI.COMM_SELF)
        self.solver.setType("preonly")
        self.solver.getPC().setType("lu")
        self.solver.getPC().setFactorSolverType("mumps")
        self.longest_mm = LONGEST_MM
        self.factored = False
        self.n_factors = self.n_iterations = 0

    def stretches(self):
        """Stretch of the cells at the quadrature points, counted from their slack length."""
        return self.stretch_of.eval(self.heart.mesh, self.cells).reshape(-1) / SLACK_STRETCH

    def vector(self, form):
        found = dolfinx.fem.assemble_vector(form).array
        found[self.dofs] = 0.0
        return found

    def volume_ml(self):
        return dolfinx.fem.assemble_scalar(self.volume) / 1e3

    def pressure_mmhg(self):
        return float(self.pressure.value) / MMHG

    def factor(self):
        self.matrix.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(self.matrix, self.tangent, bcs=self.fixed)
        self.matrix.assemble()
        self.solver.setOperators(self.matrix)
        self.solver.setUp()
        self.factored = True
        self.n_factors += 1

    def solve(self, right):
        b, x = self.matrix.createVecs()
        b.array[:] = right
        self.solver.solve(b, x)
        return x.array.copy()

    def equilibrium(self, cells, left_ml, tolerance=1e-5):
        """Newton's method for wall and cavity together.

        `cells(stretches)`: active stress in kPa at the points, and its slope with the stretch.
        `left_ml(pressure)`: volume that the circulation leaves in the cavity at a pressure in mmHg, falling with it.
        The factor of an earlier tangent serves for as long as it converges.
        """
        before, fresh = math.inf, False
        for iteration in range(25):
            stress, slope = cells(self.stretches())
            self.active.x.array[self.points.reshape(-1)] = 1e3 * stress
            self.slope.x.array[self.points.reshape(-1)] = 1e3 * slope / SLACK_STRETCH
            residual, load = self.vector(self.residual), self.vector(self.gradient)
            volume, pressure = self.volume_ml(), self.pressure_mmhg()
            off = np.linalg.norm(residual) / max(np.linalg.norm(load) * max(abs(pressure), 5.0) * MMHG, 1e-12)
            missing = abs(volume - left_ml(pressure))
            if not math.isfinite(off):
                raise Diverged("the residual is not finite")
            if off < tolerance and missing < 1e-3:
                return iteration
            error = max(off / tolerance, missing / 1e-3)
            if not self.factored or (error > 0.2 * before and not fresh):
                self.factor()
                fresh = True
            elif fresh and error > 0.2 * before:
                self.factor()
            before = error
            self.n_iterations += 1
            x, y = self.solve(-residual), self.solve(load)
            # Along x + y Δp the volume is linear; with what the circulation leaves it meets in one pressure.
            own, per_pa = 1e-3 * load @ x, 1e-3 * load @ y
            step = root(lambda dp: volume + own + per_pa * dp * MMHG - left_ml(pressure + dp))
            change = x + y * step * MMHG
            scale = min(1.0, self.longest_mm / max(np.abs(change[self.moves]).max(), 1e-12))
            self.w.x.array[:] += scale * change
            self.pressure.value = (pressure + scale * step) * MMHG
        raise Diverged(f"no equilibrium after {iteration + 1} iterations: residual {off:.1e}, volume off by {missing:.1e} mL")

    def inflate(self, edv_ml, edp_mmhg, steps=8):
        """Inflates the unloaded wall to end-diastole; the stiffness is the one that gives its pressure there."""
        unloaded = self.volume_ml()
        relaxed = lambda stretches: (np.zeros_like(stretches), np.zeros_like(stretches))
        self.stiffness.value = 400.0
        for k in range(1, steps + 1):
            target = unloaded + (edv_ml - unloaded) * k / steps
            self.factored = False
            self.equilibrium(relaxed, lambda _: target)
        for _ in range(20):
            ratio = edp_mmhg / self.pressure_mmhg()
            if abs(ratio - 1) < 1e-4:
                break
            # At a given volume the pressure of an incompressible wall is proportional to its stiffness, but for the spring.
            self.stiffness.value = float(self.stiffness.value) * ratio
            self.pressure.value = float(self.pressure.value) * ratio
            self.w.x.array[self.wall_pressures] *= ratio
            self.factored = False
            self.equilibrium(relaxed, lambda _: edv_ml)


def root(function, nearest=1e-3, farthest=1e5):
    """The root of a function of one variable that is nearest to zero, up to a factor of two in the search."""
    at_zero = function(0.0)
    if at_zero == 0:
        return 0.0
    reach = nearest
    while True:
        found = [end for end in (-reach, reach) if function(end) * at_zero <= 0]
        if found:
            break
        reach *= 2
        if reach > farthest:
            raise Diverged("no pressure balances wall and circulation")
    inner, outer = 0.0, found[0]
    for _ in range(80):
        middle = 0.5 * (inner + outer)
        if function(middle) * at_zero > 0:
            inner = middle
        else:
            outer = middle
    return 0.5 * (inner + outer)
