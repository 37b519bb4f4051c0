"""A twin of arrays, without a folder."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cardiotwin._cohort import Cohort
from cardiotwin._commands import measured
from cardiotwin._errors import ProblemsError, without_folder
from cardiotwin._measurements import Arrays, Measurements
from cardiotwin._run import Patient
from cardiotwin._settings import Setting

if TYPE_CHECKING:
    from typing_extensions import Unpack

_PATIENT = "patient"


def fit(
    measurements: Measurements | None = None,
    *,
    fidelity: str | None = None,
    settings: Mapping[str, Setting] | None = None,
    workers: int | None = None,
    progress: bool = False,
    **arrays: Unpack[Arrays],
) -> Patient:
    """Personalises one patient from arrays: ``fit(time_ms=t, pressure_mmHg=p, volume_mL=v, cycle_length_ms=800,
    fidelity="reduced").twin``; the arrays are the keywords of `Measurements`.

    Cohort and run lie in a temporary folder, which is removed with the last object that needs it: keep the
    returned patient, or its twin. To keep the files, use `Measurements.write` and `Cohort`.

    Raises `InputError` for measurements that cannot be used, `ProblemsError` where the personalisation fails.
    """
    wanted = measured(measurements, arrays)
    place = Path(tempfile.mkdtemp(prefix="cardiotwin-"))
    try:
        (place / "cohort.toml").write_text('name = "arrays"\npatients = "patients"\n', encoding="utf-8")
        folder = wanted.write(place / "patients" / _PATIENT)
        with without_folder(folder):
            run = Cohort(place).run(
                fidelity=fidelity, settings=settings, workers=workers, progress=progress, report=False
            )
        patient = run.patients[_PATIENT]
        if patient.status["state"] != "done":
            failure: dict[str, Any] = patient.record.get("failure") or {}
            message = failure.get("message") or patient.status["note"] or patient.status["state"]
            raise ProblemsError("; ".join(filter(None, [str(message), failure.get("remedy")])))
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise
    weakref.finalize(run.place, shutil.rmtree, place, ignore_errors=True)
    return patient
