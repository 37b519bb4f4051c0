//! Indices of a beat by which a treatment is judged.

use std::collections::BTreeMap;

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_signals::pressure_volume_loop::stroke_work_mj;

/// Biomarkers among the indices, in the order of the table.
const OF_BEAT: [Biomarker; 8] = [
    Biomarker::PMax,
    Biomarker::Edp,
    Biomarker::DpdtMax,
    Biomarker::DpdtMin,
    Biomarker::Ptd90,
    Biomarker::Edv,
    Biomarker::Esv,
    Biomarker::Sv,
];

/// Traces of one beat.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Traces {
    /// Columns of `traces.csv` by name.
    columns: BTreeMap<String, Vec<f64>>,
}

impl Traces {
    /// Reads `traces.csv` up to the first row with a missing cell or a cell that is not a number.
    pub fn of(text: &str) -> Self {
        let mut lines = text.lines();
        let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let mut columns = vec![Vec::new(); names.len()];
        for line in lines {
            let row: Vec<f64> = line
                .split(',')
                .map_while(|cell| cell.parse().ok())
                .collect();
            if row.len() != names.len() {
                break;
            }
            columns
                .iter_mut()
                .zip(row)
                .for_each(|(column, value)| column.push(value));
        }
        Self {
            columns: names.into_iter().map(str::to_owned).zip(columns).collect(),
        }
    }

    /// A column by name; empty if the traces lack it.
    pub fn column(&self, name: &str) -> &[f64] {
        self.columns.get(name).map_or(&[], Vec::as_slice)
    }

    /// Points of column `y` over column `x`.
    pub fn points(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        self.column(x)
            .iter()
            .copied()
            .zip(self.column(y).iter().copied())
            .collect()
    }
}

/// Indices by name, in the order of the table. An index that the beat lacks is left out.
pub fn indices(
    biomarkers: &Biomarkers,
    traces: &Traces,
    cycle_length_ms: f64,
) -> Vec<(&'static str, f64)> {
    let aorta = traces.column("aortic_pressure_mmHg");
    let extreme = |of: fn(f64, f64) -> f64| aorta.iter().copied().reduce(of);
    let mean = (!aorta.is_empty()).then(|| aorta.iter().sum::<f64>() / aorta.len() as f64);
    let sv = biomarkers.sv_ml;
    let derived = [
        (
            "ejection_fraction",
            sv.zip(biomarkers.edv_ml).map(|(sv, edv)| sv / edv),
        ),
        (
            "cardiac_output_L_per_min",
            sv.map(|sv| 60.0 * sv / cycle_length_ms),
        ),
        (
            "stroke_work_mJ",
            stroke_work_mj(traces.column("volume_mL"), traces.column("pressure_mmHg")),
        ),
        ("aortic_systolic_mmHg", extreme(f64::max)),
        ("aortic_diastolic_mmHg", extreme(f64::min)),
        ("aortic_mean_mmHg", mean),
    ];
    OF_BEAT
        .map(|biomarker| (biomarker.key(), biomarkers.get(biomarker)))
        .into_iter()
        .chain(derived)
        .filter_map(|(name, value)| Some((name, value?)))
        .collect()
}

/// Value of an index by name.
pub fn value_of(indices: &[(&'static str, f64)], name: &str) -> Option<f64> {
    let found = indices.iter().find(|(other, _)| *other == name)?;
    Some(found.1)
}

/// Relative changes, by which the twin's indices are multiplied, of those that both beats have.
///
/// The end-systolic volume follows from the end-diastolic one and the stroke between them. With a share
/// of its own, the predicted volumes would not differ by the predicted stroke volume.
pub fn changes(
    twin: &[(&'static str, f64)],
    before: &[(&'static str, f64)],
    after: &[(&'static str, f64)],
) -> Vec<(&'static str, f64)> {
    let share = |before: f64, after: f64| (after - before) / before;
    let (edv, esv) = (Biomarker::Edv.key(), Biomarker::Esv.key());
    let stroke = |beat: &[_]| Some(value_of(beat, edv)? - value_of(beat, esv)?);
    let of_esv = || {
        let filled = value_of(twin, edv)? * share(value_of(before, edv)?, value_of(after, edv)?);
        let ejected = stroke(twin)? * share(stroke(before)?, stroke(after)?);
        Some((filled - ejected) / value_of(twin, esv)?)
    };
    let change = |(name, before): &(&'static str, f64)| {
        let own = share(*before, value_of(after, name)?);
        let change = match *name == esv {
            true => of_esv().unwrap_or(own),
            false => own,
        };
        Some((*name, change)).filter(|(_, change)| change.is_finite())
    };
    before.iter().filter_map(change).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangular_loop_does_pressure_times_volume() {
        let text = "time_ms,pressure_mmHg,volume_mL,aortic_pressure_mmHg\n\
                    0,10,120,80\n1,110,120,100\n2,110,50,120\n3,10,50,100\nx,,,\n";
        let traces = Traces::of(text);
        let biomarkers = Biomarkers {
            sv_ml: Some(70.0),
            edv_ml: Some(120.0),
            ..Biomarkers::default()
        };
        let found: BTreeMap<_, _> = indices(&biomarkers, &traces, 700.0).into_iter().collect();
        assert!(
            (found["stroke_work_mJ"] - 0.133_322_4 * 100.0 * 70.0).abs() < 1e-9,
            "{found:?}"
        );
        assert_eq!(
            (found["aortic_systolic_mmHg"], found["aortic_mean_mmHg"]),
            (120.0, 100.0)
        );
        assert!((found["ejection_fraction"] - 7.0 / 12.0).abs() < 1e-12);
        assert!(
            (found["cardiac_output_L_per_min"] - 6.0).abs() < 1e-12,
            "70 mL at 86 beats a minute"
        );
        assert!(
            !found.contains_key("P_max_mmHg"),
            "what a beat does not have is left out"
        );
    }

    #[test]
    fn predicted_volumes_differ_by_the_predicted_stroke() {
        let beat = |edv: f64, sv: f64| {
            [
                ("EDV_mL", edv),
                ("ESV_mL", edv - sv),
                ("SV_mL", sv),
                ("P_max_mmHg", 100.0),
            ]
        };
        // The simulated ventricle is smaller than the twin's, so that its shares differ.
        let (twin, before, after) = (beat(120.0, 66.0), beat(100.0, 50.0), beat(105.0, 60.0));
        let found = changes(&twin, &before, &after);
        let predicted = |name: &str| {
            let change = value_of(&found, name).unwrap();
            value_of(&twin, name).unwrap() * (1.0 + change)
        };
        assert!(
            (predicted("SV_mL") - 79.2).abs() < 1e-9 && (predicted("EDV_mL") - 126.0).abs() < 1e-9
        );
        assert!(
            (predicted("ESV_mL") - 46.8).abs() < 1e-9,
            "{}",
            predicted("ESV_mL")
        );
        assert_eq!(value_of(&found, "P_max_mmHg"), Some(0.0));
        let unchanged = changes(&twin, &before, &before);
        assert!(
            unchanged.iter().all(|(_, change)| *change == 0.0),
            "{unchanged:?}"
        );
        // Without the twin's volumes the share is the simulated one.
        let alone = changes(&[], &before, &after);
        assert!((value_of(&alone, "ESV_mL").unwrap() + 0.1).abs() < 1e-12);
    }
}
