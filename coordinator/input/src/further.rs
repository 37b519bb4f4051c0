//! Checks of the measurements besides pressure and volume of one beat: their numbers, their files,
//! and what the files hold.

use std::path::Path;

use cardiotwin_schemas::further::FurtherQuantity;
use cardiotwin_schemas::patient::{Measured, PatientFile};
use cardiotwin_signals::checks::{self, Source};
use cardiotwin_signals::read::read_trace;
use cardiotwin_signals::{Quantity, Trace};
use cardiotwin_units::Ms;

use super::patient::Values;
use super::report::Report;

/// Largest noise of a trace, in the unit of its quantity, and its key.
fn largest_rms(of: FurtherQuantity) -> (f64, &'static str) {
    match of {
        FurtherQuantity::AorticPressure | FurtherQuantity::AtrialPressure => (50.0, "rms_mmHg"),
        FurtherQuantity::AorticFlow | FurtherQuantity::MitralFlow => (300.0, "rms_mL_per_s"),
        FurtherQuantity::Strain => (20.0, "rms_percent"),
    }
}

/// Keys that name the files of further measurements.
pub(super) fn files(measured: &Measured) -> Vec<(String, String)> {
    let traces = measured.traces.as_ref();
    let of_traces = traces.map_or(Vec::new(), |traces| traces.stated());
    let mut list: Vec<(String, String)> = of_traces
        .iter()
        .map(|trace| {
            let key = format!("measured.traces.{}.file", trace.quantity.name());
            (key, trace.file.to_owned())
        })
        .collect();
    for beat in &measured.loaded {
        let key = "measured.loaded";
        list.push((key.to_owned(), beat.pressure.clone()));
        list.push((key.to_owned(), beat.volume.clone()));
    }
    list
}

impl Values<'_> {
    /// Checks the numbers of further measurements, and that their files exist.
    pub(super) fn further(&mut self, measured: &Measured, cycle_ms: f64) {
        for (key, name) in files(measured) {
            self.trace_file(&key, Some(&name));
        }
        for trace in measured.traces.iter().flat_map(|traces| traces.stated()) {
            let table = format!("measured.traces.{}", trace.quantity.name());
            let (largest, key) = largest_rms(trace.quantity);
            let unit = trace.quantity.unit();
            self.range(&format!("{table}.{key}"), trace.rms, 0.0, largest, unit);
            let correlation = format!("{table}.correlation_ms");
            self.range(&correlation, trace.correlation_ms, 0.0, 1000.0, "ms");
            // A wedge pressure comes 100 to 150 ms late; three times that is another error.
            self.range(
                &format!("{table}.delay_ms"),
                trace.delay_ms,
                0.0,
                400.0,
                "ms",
            );
            self.range(
                &format!("{table}.delay_sd_ms"),
                trace.delay_sd_ms,
                0.0,
                200.0,
                "ms",
            );
        }
        if let Some(times) = &measured.valve_times {
            let keys = [
                ("aortic_opening_ms", times.aortic_opening_ms),
                ("aortic_closure_ms", times.aortic_closure_ms),
                ("mitral_opening_ms", times.mitral_opening_ms),
                ("mitral_closure_ms", times.mitral_closure_ms),
            ];
            for (key, value) in keys {
                let key = format!("measured.valve_times.{key}");
                if cycle_ms > 0.0 {
                    self.range(&key, value, 0.0, cycle_ms, "ms");
                }
            }
            self.range("measured.valve_times.sd_ms", times.sd_ms, 0.0, 100.0, "ms");
            let ejection = times.aortic_opening_ms.zip(times.aortic_closure_ms);
            if let Some((opening, closure)) = ejection
                && closure <= opening
            {
                self.add(
                    "measured.valve_times.aortic_closure_ms",
                    format!("{closure} ms, and the opening at {opening} ms"),
                    "a closure after the opening",
                    "count both from the traces' zero, in milliseconds; swap them if they are interchanged",
                );
            }
        }
        if let Some(qrs) = &measured.qrs {
            let duration = Some(qrs.duration_ms);
            self.range("measured.qrs.duration_ms", duration, 40.0, 300.0, "ms");
            self.range("measured.qrs.sd_ms", qrs.sd_ms, 0.0, 100.0, "ms");
        }
        for beat in &measured.loaded {
            let cycle = beat.cycle_length_ms;
            self.range("measured.loaded", cycle, 200.0, 3000.0, "ms");
        }
    }
}

/// Reads the traces of further measurements and reports their problems.
pub(super) fn check(file: &PatientFile, folder: &Path, cycle_is_sound: bool, report: &mut Report) {
    let patient = folder.file_name().and_then(|name| name.to_str());
    let read = |name: &str, quantity: Quantity, report: &mut Report| -> Option<Trace> {
        let path = folder.join(name);
        if !path.is_file() {
            return None; // `check_values` of the patient reports it
        }
        let reading = read_trace(&path, quantity);
        for problem in reading.problems {
            report.add(patient, problem);
        }
        reading.trace
    };
    let measured = &file.measured;
    for stated in measured.traces.iter().flat_map(|traces| traces.stated()) {
        let Some(trace) = read(stated.file, stated.quantity.into(), report) else {
            continue;
        };
        if cycle_is_sound {
            let path = folder.join(stated.file);
            let source = Source {
                file: &path,
                trace: &trace,
            };
            for problem in checks::check_further(stated.quantity, source, Ms(file.cycle_length_ms))
            {
                report.add(patient, problem);
            }
        }
    }
    for beat in &measured.loaded {
        let cycle = beat.cycle_length_ms.unwrap_or(file.cycle_length_ms);
        let pressure = read(&beat.pressure, Quantity::Pressure, report);
        let volume = read(&beat.volume, Quantity::Volume, report);
        if !cycle_is_sound {
            continue;
        }
        let [pressure_file, volume_file] = [&beat.pressure, &beat.volume].map(|f| folder.join(f));
        let problems = checks::check(&checks::Measured {
            patient_file: &folder.join("patient.toml"),
            cycle_length: Ms(cycle),
            pressure: pressure.as_ref().map(|trace| Source {
                file: &pressure_file,
                trace,
            }),
            volume: volume.as_ref().map(|trace| Source {
                file: &volume_file,
                trace,
            }),
            end_diastolic_pressure: None,
            left_atrial_pressure: None,
            forward_stroke_volume: None,
            accepted: &measured.accept,
        });
        for problem in problems {
            report.add(patient, problem);
        }
    }
}
