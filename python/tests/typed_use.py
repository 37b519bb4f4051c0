"""Uses of the package as type checkers see them: lists, arrays and tables pass, and slips do not.

mypy and pyright check this file in their strict modes. Nothing runs it.
"""

from __future__ import annotations

import cardiotwin
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from typing_extensions import assert_type

Floats = NDArray[np.float64]


def lists_where_several_are_meant(cohort: cardiotwin.Cohort) -> None:
    settings: dict[str, list[str] | float | bool] = {"step3.parameters": ["n_Tm", "phi"], "step2.seed": 2}
    run = cohort.run(patients=["01-CoA"], settings=settings)
    cohort.run(
        patients={"01-CoA", "03-CoA"}, settings={"step2.bounds.n_Tm": [4, 6], "workflow.until": "step2-verification"}
    )
    options = ["--parquet"]
    run.export("tables", *options)
    cardiotwin.call(*["check", "my-cohort"], accept=[0, 1])
    cardiotwin.sweep(samples=32, bounds={"n_Tm": [4, 6], "phi": (1.0, 2.0)}, set={"r_S": 0.3})
    cardiotwin.discover("patient", effects=["atrial-kick"])
    cardiotwin.cell_beats([[0.7, 5], [0.8, 6]], ["Ca50_ref_uM", "n_Tm"])
    cardiotwin.cell_beats(np.ones((2, 1)), pd.Index(["phi"]), {"n_Tm": 5})
    cardiotwin.Ventricle.average().beats([[1.0]], ("compliance_mL_per_mmHg",))


def mapping_of_patients(run: cardiotwin.Run) -> list[str]:
    for name, patient in run.patients.items():
        assert_type(name, str)
        assert_type(patient, cardiotwin.Patient)
    return [name for name in run.patients if run.patients[name].twin.personalised]


def twin(patient: cardiotwin.Patient) -> None:
    twin = patient.twin
    change: dict[str, str] = {"resistance": "-20 %"}
    stent = twin.predict(change, cycle_length_ms=700)
    assert_type(stent["SV_mL"].p95, float)
    assert_type(stent.after["pressure_mmHg"], Floats)
    assert_type(stent.table, pd.DataFrame)
    assert_type(twin.beat(compliance="+10 %").biomarkers["SV_mL"], float)
    assert_type(twin.biomarkers[["SV_mL", "P_max_mmHg"]], cardiotwin.Values)
    draws = twin.posterior.sample(10, seed=1)
    assert_type(draws["Ca50_ref_uM"], Floats)
    assert_type(twin.ventricle.beats(draws)["SV_mL"], Floats)
    assert_type(twin.posterior["phi"].unit, str)


def arrays(frame: pd.DataFrame) -> None:
    times = [0.0, 1.0]
    cardiotwin.discover(time_ms=times, pressure_mmHg=[7, 8], volume_mL=np.array([120.0, 119.0]), cycle_length_ms=800)
    measured = cardiotwin.Measurements.of(frame, cycle_length_ms=800)
    assert_type(cardiotwin.fit(measured, settings={"posterior.draws": 40}).twin.name, str)


def slips(run: cardiotwin.Run, twin: cardiotwin.Twin) -> None:
    print(run.pateints)  # type: ignore[attr-defined] # pyright: ignore
    print(cardiotwin.Cohrt)  # type: ignore[attr-defined] # pyright: ignore
    twin.predict(resistance=["-20 %"])  # type: ignore[arg-type] # pyright: ignore[reportArgumentType]
    cardiotwin.discover(pressure=[1.0])  # type: ignore[call-arg] # pyright: ignore[reportCallIssue]
