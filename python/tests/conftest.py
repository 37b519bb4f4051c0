"""One reduced run of two bundled patients, shared by the tests."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cardiotwin
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the bundled cohort with two patients."""
    copy = tmp_path_factory.mktemp("cohorts") / "coa-two"
    copy.mkdir()
    shutil.copy(EXAMPLES / "coa-seven" / "cohort.toml", copy)
    for patient in ("01-CoA", "03-CoA"):
        shutil.copytree(EXAMPLES / "coa-seven" / "patients" / patient, copy / "patients" / patient)
    return copy


@pytest.fixture(scope="session")
def run(folder: Path) -> cardiotwin.Run:
    """Their reduced run."""
    return cardiotwin.Cohort(folder).run(fidelity="reduced", report=False)


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """An empty folder."""
    assert not os.listdir(tmp_path)
    return tmp_path
