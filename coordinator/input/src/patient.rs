//! Checks of a patient's file for impossible values and missing data. The signals crate checks the
//! traces, including the cycle length, which must agree with them.

use std::path::Path;

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::patient::{PatientFile, PatientMesh, PatientRightVentricle};
use cardiotwin_schemas::settings::{Settings, StartMode};
use cardiotwin_signals::Problem;
use cardiotwin_signals::checks::RIGHT_PRESSURE_MMHG;

use super::document::Document;
use super::layers::position_of;
use super::report::Report;

/// Longest pseudonym. It appears in tables, in paths and, on a cluster, in job names.
const LONGEST_ID: usize = 64;

/// Unit of resistances.
const RESISTANCE: &str = "mmHg s/mL";
/// One mmHg s/mL in dyn s/cm⁵, the unit of many laboratories: 1 mmHg is 1333.22 dyn/cm².
const DYN_S_PER_CM5: f64 = 1333.22;

/// Keys of the Windkessel with the possible values and their unit.
const AFTERLOAD: [(&str, [f64; 2], &str); 3] = [
    (
        "characteristic_resistance_mmHg_s_per_mL",
        [0.0, 10.0],
        RESISTANCE,
    ),
    (
        "peripheral_resistance_mmHg_s_per_mL",
        [0.01, 100.0],
        RESISTANCE,
    ),
    ("compliance_mL_per_mmHg", [0.001, 100.0], "mL/mmHg"),
];

/// Possible values of a parameter of the Windkessel by its key; `None` for another key.
#[must_use]
pub fn load_range(key: &str) -> Option<[f64; 2]> {
    let of_key = |(name, range, _): &(&str, [f64; 2], &str)| (*name == key).then_some(*range);
    AFTERLOAD.iter().find_map(of_key)
}

/// Checks the values of a patient's file. `folder` is the name of the folder that holds it.
pub fn check_values(file: &PatientFile, document: &Document, folder: &str, report: &mut Report) {
    let mut list = Values {
        document,
        folder,
        report,
    };
    list.identity(&file.id);
    list.measured(file);
    list.range(
        "anatomy.wall_volume_mL",
        file.anatomy.wall_volume_ml,
        1.0,
        1000.0,
        "mL",
    );
    if let Some(mesh) = &file.anatomy.mesh {
        list.mesh(mesh);
    }
    if let Some(afterload) = &file.afterload {
        let values = [
            afterload.characteristic_resistance_mmhg_s_per_ml,
            afterload.peripheral_resistance_mmhg_s_per_ml,
            afterload.compliance_ml_per_mmhg,
        ];
        for ((key, [low, high], unit), value) in std::iter::zip(AFTERLOAD, values) {
            list.range(&format!("afterload.{key}"), Some(value), low, high, unit);
        }
    }
    let preload = file
        .preload
        .as_ref()
        .map(|preload| preload.left_atrial_pressure_mmhg);
    list.range(
        "preload.left_atrial_pressure_mmHg",
        preload,
        -5.0,
        60.0,
        "mmHg",
    );
    if let Some(passive) = &file.passive {
        list.range(
            "passive.guccione_C_kPa",
            passive.guccione_c_kpa,
            1e-4,
            100.0,
            "kPa",
        );
        list.range("passive.exponent", passive.exponent, 0.1, 100.0, "");
    }
}

/// Checks that the data are sufficient for the settings with which the patient is simulated.
pub fn check_completeness(
    file: &PatientFile,
    settings: &Settings,
    document: &Document,
    report: &mut Report,
) {
    if !document.sound {
        return;
    }
    let mut list = Values {
        document,
        folder: folder_of(document, &file.id),
        report,
    };
    let measured = &file.measured;
    let given = measured.biomarkers.unwrap_or_default();
    let broken = |report: &Report, key: &str| report.is_broken(&document.file, key);
    let pressure_is_told = broken(list.report, "measured.pressure");
    let volume_is_told = broken(list.report, "measured.volume");
    if measured.pressure.is_none() && !pressure_is_told {
        let missing: Vec<&str> = Biomarker::OF_COST
            .into_iter()
            .filter(|b| !b.is_of_volume() && given.get(*b).is_none())
            .map(Biomarker::key)
            .collect();
        if !missing.is_empty() {
            list.add(
                "measured",
                format!("no pressure trace and no {}", missing.join(", ")),
                "a pressure trace, or the four pressure biomarkers",
                "add `pressure = \"pressure.csv\"` to [measured], or the missing ones to [measured.biomarkers]",
            );
        }
        if measured.end_diastolic_pressure_mmhg.is_none() && given.edp_mmhg.is_none() {
            list.add(
                "measured.end_diastolic_pressure_mmHg",
                "no such key, and no pressure trace to derive it from",
                "the pressure at end-diastole",
                "add the key to [measured]",
            );
        }
    }
    let diastasis_ml = measured
        .diastasis
        .as_ref()
        .map(|diastasis| diastasis.volume_ml);
    let end_diastolic_ml = measured.end_diastolic_volume_ml.or(given.edv_ml);
    if measured.volume.is_none()
        && !volume_is_told
        && end_diastolic_ml.is_none()
        && diastasis_ml.is_none()
    {
        list.add(
            "measured.end_diastolic_volume_mL",
            "no such key, no volume trace and no image volume",
            "the cavity's volume at end-diastole, which the ventricle needs",
            "add `end_diastolic_volume_mL` to [measured], or `volume = \"volume.csv\"`, or [measured.diastasis]",
        );
    }
    if settings.solver.start == StartMode::Diastasis && diastasis_ml.is_none() {
        list.add(
            "measured.diastasis",
            "no such table, and solver.start = \"diastasis\"",
            "the image's volume and time",
            "add [measured.diastasis] with time_ms and volume_mL, or choose solver.start = \"end-diastole\"",
        );
    }
}

/// The folder's name, by which the patient is known even if `id` differs from it.
fn folder_of<'a>(document: &'a Document, id: &'a str) -> &'a str {
    document
        .file
        .parent()
        .and_then(Path::file_name)
        .and_then(|name| name.to_str())
        .unwrap_or(id)
}

pub(super) struct Values<'a> {
    document: &'a Document,
    folder: &'a str,
    report: &'a mut Report,
}

impl Values<'_> {
    pub(super) fn add(
        &mut self,
        key: &str,
        found: impl Into<String>,
        expected: &str,
        remedy: impl Into<String>,
    ) {
        let problem = Problem::error(&self.document.file, found, expected, remedy);
        let at = position_of(self.document, key);
        self.report
            .add(Some(self.folder), problem.at_key(key).at(at));
    }

    pub(super) fn range(&mut self, key: &str, value: Option<f64>, low: f64, high: f64, unit: &str) {
        let Some(value) = value else { return };
        if !(low..=high).contains(&value) {
            let remedy = match unit {
                "ms" if value > 0.0 && value < 10.0 => {
                    "the value looks like seconds: give milliseconds".to_owned()
                }
                RESISTANCE if value > high => format!(
                    "the unit is mmHg s/mL: {value} dyn s/cm5 is {:.4} mmHg s/mL, the value over {DYN_S_PER_CM5}",
                    value / DYN_S_PER_CM5
                ),
                _ if high < 0.0 && value > 0.0 => {
                    "the quantity is negative: write the sign".to_owned()
                }
                _ => "correct the value; its unit is in the key's name".to_owned(),
            };
            let expected = format!("{low} to {high} {unit}");
            self.add(
                key,
                format!("{value} {unit}").trim_end(),
                expected.trim_end(),
                remedy,
            );
        }
    }

    fn identity(&mut self, id: &str) {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if id != self.folder {
            let remedy = format!("write id = {:?}, or rename the folder", self.folder);
            let expected = format!("the folder's name, {:?}", self.folder);
            self.add("id", format!("{id:?}"), &expected, remedy);
        } else if id.is_empty()
            || id.len() > LONGEST_ID
            || !id.chars().all(plain)
            || id.starts_with(['.', '-'])
        {
            let expected =
                "1 to 64 letters, digits, `-`, `_` or `.`, beginning with a letter, digit or `_`";
            self.add(
                "id",
                format!("{id:?}"),
                expected,
                "choose another pseudonym and rename the folder accordingly",
            );
        }
    }

    fn mesh(&mut self, mesh: &PatientMesh) {
        const UNITS: [&str; 4] = ["um", "mm", "cm", "m"];
        if !UNITS.contains(&mesh.unit.as_str()) {
            let expected = format!("one of {}", UNITS.join(", "));
            self.add(
                "anatomy.mesh.unit",
                format!("{:?}", mesh.unit),
                &expected,
                "state the unit of the coordinates",
            );
        }
        if mesh.left_ventricle.is_empty() {
            let remedy = "list the tags of contracting tissue, as in left_ventricle = [1]";
            self.add(
                "anatomy.mesh.left_ventricle",
                "no tag",
                "at least one tag",
                remedy,
            );
        }
        let folder = self
            .document
            .file
            .parent()
            .map(Path::to_owned)
            .unwrap_or_default();
        let ending = Path::new(&mesh.file)
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or_default();
        let names = match ending {
            "vtu" | "msh" | "mesh" => vec![mesh.file.clone()],
            _ => vec![format!("{}.pts", mesh.file), format!("{}.elem", mesh.file)],
        };
        for name in names.iter().filter(|name| !folder.join(name).is_file()) {
            let expected =
                "the stem of CARP files, or a .vtu, .msh or .mesh file, beside patient.toml";
            self.add(
                "anatomy.mesh.file",
                format!("no file {name:?}"),
                expected,
                "put the file there or correct its name",
            );
        }
        if let Some(right) = &mesh.right_ventricle {
            self.right_ventricle(right);
        }
        match (
            &mesh.activation_times_ms,
            mesh.activation_sites_mm.is_empty(),
        ) {
            (Some(name), true) => {
                if !folder.join(name).is_file() {
                    let (found, expected) = (
                        format!("no file {name:?}"),
                        "a file with one number per node",
                    );
                    self.add(
                        "anatomy.mesh.activation_times_ms",
                        found,
                        expected,
                        "put the file there or correct its name",
                    );
                }
            }
            (None, false) => {}
            (times, _) => {
                let found = if times.is_some() {
                    "times and sites"
                } else {
                    "neither times nor sites"
                };
                let expected = "activation_times_ms or activation_sites_mm";
                self.add(
                    "anatomy.mesh",
                    found,
                    expected,
                    "give the sites of first activation in mm, or name a file of activation times",
                );
            }
        }
    }

    fn right_ventricle(&mut self, right: &PatientRightVentricle) {
        let (low, high) = (*RIGHT_PRESSURE_MMHG.start(), *RIGHT_PRESSURE_MMHG.end());
        self.range(
            "anatomy.mesh.right_ventricle.pressure_mmHg",
            right.pressure_mmhg,
            low,
            high,
            "mmHg",
        );
        self.trace_file(
            "anatomy.mesh.right_ventricle.pressure",
            right.pressure.as_deref(),
        );
        let found = match (right.pressure_mmhg, &right.pressure) {
            (Some(_), Some(_)) => "a pressure and a trace",
            (None, None) => "neither a pressure nor a trace",
            _ => return,
        };
        let remedy = "give pressure_mmHg for the same pressure at all times, or pressure = \"rv_pressure.csv\" with the columns \
                      time_ms,pressure_mmHg over one cycle";
        self.add(
            "anatomy.mesh.right_ventricle",
            found,
            "either pressure_mmHg or pressure",
            remedy,
        );
    }

    fn measured(&mut self, file: &PatientFile) {
        let measured = &file.measured;
        let cycle_ms = file.cycle_length_ms;
        let files = [
            ("measured.pressure", &measured.pressure),
            ("measured.volume", &measured.volume),
            ("measured.calcium", &measured.calcium),
        ];
        for (key, name) in files {
            self.trace_file(key, name.as_deref());
        }
        self.range(
            "measured.end_diastolic_pressure_mmHg",
            measured.end_diastolic_pressure_mmhg,
            -10.0,
            60.0,
            "mmHg",
        );
        self.range(
            "measured.end_diastolic_volume_mL",
            measured.end_diastolic_volume_ml,
            5.0,
            1000.0,
            "mL",
        );
        if let Some(noise) = &measured.noise {
            self.range(
                "measured.noise.pressure_rms_mmHg",
                noise.pressure_rms_mmhg,
                0.0,
                50.0,
                "mmHg",
            );
            self.range(
                "measured.noise.pressure_correlation_ms",
                noise.pressure_correlation_ms,
                0.0,
                1000.0,
                "ms",
            );
            self.range(
                "measured.noise.volume_rms_mL",
                noise.volume_rms_ml,
                0.0,
                100.0,
                "mL",
            );
        }
        if let Some(aorta) = &measured.aortic_pressure {
            self.range(
                "measured.aortic_pressure.systolic_mmHg",
                Some(aorta.systolic_mmhg),
                30.0,
                350.0,
                "mmHg",
            );
            self.range(
                "measured.aortic_pressure.diastolic_mmHg",
                Some(aorta.diastolic_mmhg),
                10.0,
                250.0,
                "mmHg",
            );
            self.range(
                "measured.aortic_pressure.sd_mmHg",
                aorta.sd_mmhg,
                0.0,
                100.0,
                "mmHg",
            );
            if aorta.diastolic_mmhg >= aorta.systolic_mmhg {
                let found = format!(
                    "{} mmHg at a systolic pressure of {} mmHg",
                    aorta.diastolic_mmhg, aorta.systolic_mmhg
                );
                let key = "measured.aortic_pressure.diastolic_mmHg";
                self.add(
                    key,
                    found,
                    "diastolic below systolic",
                    "swap the two or correct them",
                );
            }
        }
        if let Some(flow) = &measured.forward_stroke_volume {
            self.range(
                "measured.forward_stroke_volume.volume_mL",
                Some(flow.volume_ml),
                1.0,
                500.0,
                "mL",
            );
            self.range(
                "measured.forward_stroke_volume.sd_mL",
                flow.sd_ml,
                0.0,
                200.0,
                "mL",
            );
        }
        if let Some(image) = &measured.diastasis {
            self.range(
                "measured.diastasis.volume_mL",
                Some(image.volume_ml),
                5.0,
                1000.0,
                "mL",
            );
            self.range("measured.diastasis.sd_mL", image.sd_ml, 0.0, 200.0, "mL");
            if cycle_ms > 0.0 && !(0.0..=cycle_ms).contains(&image.time_ms) {
                let expected = format!("a time within the beat, 0 to {cycle_ms} ms");
                let found = format!("{} ms", image.time_ms);
                self.add(
                    "measured.diastasis.time_ms",
                    found,
                    &expected,
                    "count from the traces' zero, in milliseconds",
                );
            }
        }
        self.further(measured, cycle_ms);
        if let Some(biomarkers) = &measured.biomarkers {
            self.biomarkers(biomarkers, cycle_ms);
        }
    }

    fn biomarkers(&mut self, b: &Biomarkers, cycle_ms: f64) {
        let longest_ms = if cycle_ms > 0.0 { cycle_ms } else { 3000.0 };
        for (biomarker, low, high) in [
            (Biomarker::PMax, 20.0, 400.0),
            (Biomarker::DpdtMax, 0.05, 20.0),
            (Biomarker::DpdtMin, -20.0, -0.05),
            (Biomarker::Ptd90, 20.0, longest_ms),
            (Biomarker::Sv, 1.0, 500.0),
            (Biomarker::TauVd, 1.0, longest_ms),
            (Biomarker::TauVr, 1.0, longest_ms),
            (Biomarker::Edv, 5.0, 1000.0),
            (Biomarker::Esv, 0.5, 1000.0),
            (Biomarker::Edp, -10.0, 60.0),
        ] {
            self.range(
                &format!("measured.biomarkers.{biomarker}"),
                b.get(biomarker),
                low,
                high,
                biomarker.unit(),
            );
        }
    }

    pub(super) fn trace_file(&mut self, key: &str, name: Option<&str>) {
        let Some(name) = name else { return };
        let folder = self.document.file.parent().unwrap_or(Path::new("."));
        let path = folder.join(name);
        if !path.is_file() {
            let found = format!("{name:?}, but there is no file {}", path.display());
            self.add(
                key,
                found,
                "a trace file beside patient.toml",
                "put the file there or correct its name",
            );
        }
    }
}
