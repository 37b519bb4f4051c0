"""Reference action potentials of Luo and Rudy's model of 1991, from Myokit's own implementation.

    pip install -r requirements.txt
    python luo_rudy1991.py ../tests/data

The equations are those of the example model that Myokit installs (M. Clerx, BSD 3-clause), evaluated by Myokit; SciPy's
LSODA integrates them at a relative tolerance of 1e-9, restarted at each edge of the stimulus. Myokit's example follows an
update of the authors' web site, so four constants are set back to the paper's, as curated in the CellML repository:
g_Na 23 mS/cm2, Na_i 18 mM, and ln(Ca_i) in E_si where Ca_i is in mM (Ca_o 1); F 96484.6 C/mol.

The example's switch at -40 mV is a steep sigmoid (0.24 mV wide) where the paper has a step.
"""

import math
import sys
from pathlib import Path

import myokit
import myokit.formats.python
import numpy as np
from scipy.integrate import solve_ivp

STIMULUS_UA_CM2 = 25.5
STIMULUS_MS = 2.0
START_MS = 10.0


def the_model():
    model = myokit.load(str(Path(myokit.DIR_MYOKIT) / "_bin" / "example.mmt"))[0]
    constants = {
        "ina.gNa": 23.0,
        "cell.Na_i": 18.0,
        "cell.Ca_o": 1.0,
        "cell.RTF.F": 96484.6,
        "membrane.i_stim.stim_amplitude": -STIMULUS_UA_CM2,
    }
    for name, value in constants.items():
        model.get(name).set_rhs(value)
    model.validate()
    return model


def right_hand_side(model):
    """The model's equations, in the order in which Myokit solves them, as a compiled Python function f(y, time, pace)."""
    writer = myokit.formats.python.PythonExpressionWriter()

    def name(left):
        mangled = left.var().qname().replace(".", "_")
        return "d_" + mangled if isinstance(left, myokit.Derivative) else mangled

    writer.set_lhs_function(name)
    states = [state.qname().replace(".", "_") for state in model.states()]
    lines = ["def f(y, engine_time, engine_pace):", "    " + ", ".join(states) + " = y"]
    for equations in model.solvable_order().values():
        for equation in equations:
            if equation.lhs.var().binding() is None:
                lines.append("    " + writer.eq(equation))
            elif equation.lhs.var().binding() not in ("time", "pace"):
                lines.append("    " + name(equation.lhs) + " = 0.0")
    lines.append("    return [" + ", ".join("d_" + state for state in states) + "]")
    space = {"math": math}
    exec("\n".join(lines), space)
    f = space["f"]
    state = model.initial_values(as_floats=True)
    expected = model.evaluate_derivatives(state, inputs={"time": 0.0, "pace": 1.0})
    assert np.allclose(f(state, 0.0, 1.0), expected, rtol=1e-14), "the function is not the model"
    return f


def integrate(f, state, length_ms, stimulated, samples):
    """States at `samples` (ms from the beginning) and the last state."""

    def slope_with(pace):
        return lambda t, y: f(y, t, pace)

    edges = [0.0, START_MS, START_MS + STIMULUS_MS, length_ms] if stimulated else [0.0, length_ms]
    rows = []
    for begin, end in zip(edges[:-1], edges[1:]):
        on = stimulated and begin == START_MS
        inside = samples[(samples >= begin) & ((samples < end) | (samples == length_ms))]
        inside = inside[inside <= end]
        found = solve_ivp(
            slope_with(1.0 if on else 0.0),
            (begin, end),
            state,
            method="LSODA",
            rtol=1e-9,
            atol=1e-12,
            t_eval=np.unique(np.append(inside, end)),
        )
        assert found.success, found.message
        rows += [(t, *y) for t, y in zip(found.t, found.y.T) if t in inside]
        state = found.y[:, -1]
    return np.array(rows), state


def main(folder):
    model = the_model()
    f = right_hand_side(model)
    names = [variable.qname() for variable in model.states()]
    print(names)
    potential, calcium = names.index("membrane.V"), names.index("ica.Ca_i")
    rest = np.array(model.initial_values(as_floats=True))
    # Potassium's gate relaxes within a quarter of a second: ten seconds of silence are rest.
    _, rest = integrate(f, rest, 10_000.0, False, np.array([]))
    print("rest", dict(zip(names, rest)))

    def samples(length_ms):
        # fine about the upstroke, 1 ms elsewhere
        fine = np.round(np.arange(START_MS, START_MS + 8.0, 0.1), 3)
        return np.unique(np.append(np.arange(0.0, length_ms + 0.5, 1.0), fine))

    for name, cycle_ms, n_beats in (("rest", 600.0, 1), ("cycle-1000ms", 1000.0, 8), ("cycle-600ms", 600.0, 10)):
        state = rest
        for beat in range(n_beats):
            rows, state = integrate(f, state, cycle_ms, True, samples(cycle_ms))
        with open(Path(folder) / f"luo-rudy-1991-{name}.csv", "w", encoding="ascii") as file:
            file.write(
                "# Luo-Rudy 1991 by Myokit %s and SciPy's LSODA (rtol 1e-9); made by reference/luo_rudy1991.py\n"
                "# beat %d of %d at %g ms from rest, stimulus %g uA/cm2 from %g ms for %g ms\n"
                % (myokit.__version__, n_beats, n_beats, cycle_ms, STIMULUS_UA_CM2, START_MS, STIMULUS_MS)
            )
            file.write("t_ms,v_mv,ca_mm\n")
            for row in rows:
                file.write("%.1f,%.6f,%.9f\n" % (row[0], row[1 + potential], row[1 + calcium]))
        print(name, len(rows))


if __name__ == "__main__":
    main(sys.argv[1])
