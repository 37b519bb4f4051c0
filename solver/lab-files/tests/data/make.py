"""Writes the fixtures from the first two seconds of examples/recordings/P001-raw with the programs'
own libraries: wfdb (PhysioNet), pyEDFlib and openpyxl. Run: python make.py"""

import csv
from pathlib import Path

import numpy as np
import openpyxl
import pyedflib
import wfdb

HERE = Path(__file__).parent
RAW = HERE / "../../../../examples/recordings/P001-raw"
rows = list(csv.DictReader(open(RAW / "catheter.csv")))[:500]
frames = list(csv.DictReader(open(RAW / "cine.csv")))
lv = np.array([float(row["lv_pressure_mmHg"]) for row in rows])
ecg = np.array([float(row["ecg_mV"]) for row in rows])
HZ = 250

for name, fmt, signals, units in [
    ("record16", "16", [lv, ecg], ["mmHg", "mV"]),
    ("record212", "212", [lv, ecg], ["mmHg", "mV"]),
    ("record32", "32", [lv, ecg], ["mmHg", "mV"]),
]:
    wfdb.wrsamp(
        name, fs=HZ, units=units, sig_name=["LVP", "ECG"], p_signal=np.column_stack(signals),
        fmt=[fmt, fmt], write_dir=str(HERE),
    )

for name, kind in [("record.edf", pyedflib.FILETYPE_EDFPLUS), ("record.bdf", pyedflib.FILETYPE_BDF)]:
    top = (1 << (15 if kind == pyedflib.FILETYPE_EDFPLUS else 23)) - 1
    writer = pyedflib.EdfWriter(str(HERE / name), 2, file_type=kind)
    for i, (label, unit, low, high) in enumerate([("LVP", "mmHg", -50, 350), ("ECG II", "mV", -10, 10)]):
        writer.setSignalHeader(i, {
            "label": label, "dimension": unit, "sample_frequency": HZ, "physical_min": low,
            "physical_max": high, "digital_min": -top - 1, "digital_max": top, "prefilter": "", "transducer": "",
        })
    writer.writeSamples([lv, ecg])
    writer.close()

book = openpyxl.Workbook()
book.active.title = "Summary"
book.active.append(["EDV", "ml"])
book.active.append([150.2, None])
sheet = book.create_sheet("LV curve")
sheet.append(["Patient", "P001"])
sheet.append([])
sheet.append(["Phase", "Time", "LV Endo Volume"])
sheet.append([None, "ms", "ml"])
for i, frame in enumerate(frames):
    sheet.append([i + 1, float(frame["time_ms"]), float(frame["volume_mL"])])
book.save(HERE / "cine.xlsx")
