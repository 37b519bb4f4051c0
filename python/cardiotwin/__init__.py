"""Personalised cardiac digital twins from Python.

Cohorts, sweeps and searches are run by the programs of the package; cells and one-fibre ventricles
are computed in this process. Names carry their units (``pressure_mmHg``).
"""

from cardiotwin._commands import (
    Discovery,
    Prediction,
    Sensitivity,
    Simulation,
    discover,
    predict,
    simulate,
    sweep,
)
from cardiotwin._errors import (
    BugError,
    Error,
    InputError,
    InterruptedRun,
    LockedError,
    ModelError,
    ProblemsError,
    StoreError,
    SystemError,
    UnfinishedError,
    UsageError,
)
from cardiotwin._models import Beat, Cells, Ventricle, cell_beat, cell_beats, cell_parameters
from cardiotwin._program import call, program, version
from cardiotwin._run import Cohort, Patient, Run

__version__ = version()

__all__ = [
    "Beat",
    "BugError",
    "Cells",
    "Cohort",
    "Discovery",
    "Error",
    "InputError",
    "InterruptedRun",
    "LockedError",
    "ModelError",
    "Patient",
    "Prediction",
    "ProblemsError",
    "Run",
    "Sensitivity",
    "Simulation",
    "StoreError",
    "SystemError",
    "UnfinishedError",
    "UsageError",
    "Ventricle",
    "call",
    "cell_beat",
    "cell_beats",
    "cell_parameters",
    "discover",
    "predict",
    "program",
    "simulate",
    "sweep",
]
