"""Prints what a run's beats miss of each patient's measured biomarkers and traces, as CSV. Python 3 alone, no packages.

    python3 twins.py CARDIOTWIN COHORT
"""

import csv
import html
import json
import math
import re
import subprocess
import sys
from pathlib import Path

BIOMARKERS = {
    "P_max": "P_max_mmHg",
    "dPdt_max": "dPdt_max_mmHg_per_ms",
    "dPdt_min": "dPdt_min_mmHg_per_ms",
    "PTD90": "PTD90_ms",
    "SV": "SV_mL",
}


def rms(simulated, measured):
    return math.sqrt(sum((a - b) ** 2 for a, b in zip(simulated, measured)) / len(measured))


def best(iterations, number):
    return next((i["run"] for i in iterations if i["number"] == number), None)


def printed(error):
    """As the report prints a percentage."""
    text = f"{abs(error):.1f}"
    sign = "" if float(text) == 0 else "+" if error > 0 else "−"
    return f"{sign}{text} %"


def main():
    program, cohort = sys.argv[1], Path(sys.argv[2])
    report = html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", (cohort / "run/report.html").read_text())))
    out = csv.writer(sys.stdout)
    out.writerow(["patient", "stage", *BIOMARKERS, "pressure_rms_mmHg", "volume_rms_mL", "beats", "personalised", "in_report"])
    for folder in sorted((cohort / "patients").iterdir()):
        shown = subprocess.run(
            [program, "show", folder.name, "--cohort", cohort, "--json"], check=True, capture_output=True, text=True
        )
        patient = json.loads(shown.stdout)
        step0 = patient["step0"]["result"]
        step3 = patient.get("step3") or {}
        beats = {
            "step 1": best(patient["iterations"], patient["step1"]["best_iteration"]),
            "verification": patient["verification"],
            "step 3": best(patient.get("step3_iterations") or [], step3.get("best_iteration")) or patient["verification"],
        }
        personalised = (patient["verdict"] or {}).get("personalised", False)
        for stage, beat in beats.items():
            # A verification beat may fail; step 3 goes on from it.
            if beat is None:
                continue
            result = beat["result"]
            measured, simulated = step0["measured"], result["biomarkers"]
            errors = [100 * (simulated[key] / measured[key] - 1) for key in BIOMARKERS.values()]
            traces = [rms(result["samples"][key], step0["samples"][key]) for key in ("pressure_mmHg", "volume_mL")]
            told = all(f"{folder.name}: {printed(error)}" in report for error in errors)
            n_beats = len(patient.get("step3_iterations") or [])
            out.writerow([folder.name, stage, *errors, *traces, n_beats, int(personalised), int(told)])


if __name__ == "__main__":
    main()
