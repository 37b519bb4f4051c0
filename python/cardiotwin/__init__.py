"""Personalised cardiac digital twins from Python.

Cohorts, sweeps and searches are run by the programs of the package; cells and one-fibre ventricles
are computed in this process. Names carry their units (``pressure_mmHg``).
"""

from typing import TYPE_CHECKING

try:
    from cardiotwin import _native as _native
except ImportError as error:
    raise ImportError(
        f"{__path__[0]} has no compiled part: it is a folder of sources. Leave this folder and install the package: "
        "`make wheel` in the repository, then `pip install dist/cardiotwin-*.whl` (docs/python.md)"
    ) from error

from cardiotwin._cohort import Cohort
from cardiotwin._commands import Discovery, Sensitivity, Simulation, discover, predict, simulate, sweep
from cardiotwin._errors import (
    BugError,
    Error,
    FileError,
    InputError,
    InterruptedRun,
    LockedError,
    MissingExtraError,
    ModelError,
    ProblemsError,
    StoreError,
    UnfinishedError,
    UnknownNameError,
    UsageError,
)
from cardiotwin._fit import fit
from cardiotwin._measurements import Measurements
from cardiotwin._models import Beat, Cells, Ventricle, cell_beat, cell_beats, cell_parameters
from cardiotwin._prediction import Changed, Predicted, Prediction
from cardiotwin._program import call, program, version
from cardiotwin._run import Patient, Patients, Run
from cardiotwin._twin import Interval, Posterior, Twin
from cardiotwin._values import Draws, Traces, Values

__version__ = version()

__all__ = [
    "Beat",
    "BugError",
    "Cells",
    "Changed",
    "Cohort",
    "Discovery",
    "Draws",
    "Error",
    "FileError",
    "InputError",
    "InterruptedRun",
    "Interval",
    "LockedError",
    "Measurements",
    "MissingExtraError",
    "ModelError",
    "Patient",
    "Patients",
    "Posterior",
    "Predicted",
    "Prediction",
    "ProblemsError",
    "Run",
    "Sensitivity",
    "Simulation",
    "StoreError",
    "Traces",
    "Twin",
    "UnfinishedError",
    "UnknownNameError",
    "UsageError",
    "Values",
    "Ventricle",
    "call",
    "cell_beat",
    "cell_beats",
    "cell_parameters",
    "discover",
    "fit",
    "predict",
    "program",
    "simulate",
    "sweep",
]

# Hidden from type checkers, which would otherwise let every name pass.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name == "SystemError":  # its name of old, which hid Python's own
            return FileError
        if name.startswith("_"):
            raise AttributeError(f"module cardiotwin has no attribute {name}")
        from cardiotwin._names import unknown

        raise AttributeError(f"module cardiotwin has no attribute {unknown(name, __all__, 'it has')}")
