//! The predicted beat as traces: those of the simulated ventricle after the change, moved so that
//! they have the predicted extremes.

use super::indices::Traces;
use super::predicted::Predicted;

/// A map of one quantity, `value ↦ offset + factor · value`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Map {
    offset: f64,
    factor: f64,
}

impl Map {
    /// The map that takes two simulated values to the predicted ones; the identity where one of them
    /// is missing or both are equal.
    fn through(low: Option<&Predicted>, high: Option<&Predicted>) -> Self {
        let values = |index: &Predicted| Some((index.simulated_after?, index.predicted?));
        let ends = low.and_then(values).zip(high.and_then(values));
        let ends = ends.filter(|((low, _), (high, _))| low != high);
        let factor = ends.map_or(1.0, |((low, to_low), (high, to_high))| {
            (to_high - to_low) / (high - low)
        });
        Self {
            offset: ends.map_or(0.0, |((low, to_low), _)| to_low - factor * low),
            factor,
        }
    }

    /// The map that takes one simulated value to the predicted one and leaves zero where it is.
    fn scaling(index: Option<&Predicted>) -> Self {
        let of = |index: &Predicted| index.predicted.zip(index.simulated_after);
        let factor = index.and_then(of).map(|(to, from)| to / from);
        Self {
            offset: 0.0,
            factor: factor.filter(|factor| factor.is_finite()).unwrap_or(1.0),
        }
    }
}

/// Text of `traces.csv` of the predicted beat. Pressures and volume reach the extremes of the table,
/// flows carry its stroke volume.
pub fn predicted(simulated: &str, indices: &[Predicted]) -> String {
    let index = |name: &str| indices.iter().find(|index| index.name == name);
    let map = |column: &str| match column {
        "pressure_mmHg" => Map::through(index("EDP_mmHg"), index("P_max_mmHg")),
        "volume_mL" => Map::through(index("ESV_mL"), index("EDV_mL")),
        "aortic_pressure_mmHg" => Map::through(
            index("aortic_diastolic_mmHg"),
            index("aortic_systolic_mmHg"),
        ),
        "aortic_flow_mL_per_s" | "mitral_flow_mL_per_s" => Map::scaling(index("SV_mL")),
        _ => Map {
            offset: 0.0,
            factor: 1.0,
        },
    };
    let traces = Traces::of(simulated);
    let names: Vec<&str> = simulated
        .lines()
        .next()
        .unwrap_or_default()
        .split(',')
        .collect();
    let maps: Vec<Map> = names.iter().map(|name| map(name)).collect();
    let n = names.iter().map(|name| traces.column(name).len()).min();
    let mut text = names.join(",") + "\n";
    for row in 0..n.unwrap_or(0) {
        let cells = names.iter().zip(&maps).map(|(name, map)| {
            let value = map.offset + map.factor * traces.column(name)[row];
            format!("{}", (value * 1e6).round() / 1e6)
        });
        text += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(name: &'static str, simulated_after: f64, predicted: f64) -> Predicted {
        Predicted {
            name,
            twin: None,
            relative_change: None,
            predicted: Some(predicted),
            band: None,
            band_within_model: None,
            known: None,
            simulated_before: None,
            simulated_after: Some(simulated_after),
        }
    }

    #[test]
    fn the_traces_reach_what_the_table_says() {
        let simulated = "time_ms,pressure_mmHg,volume_mL,aortic_pressure_mmHg,aortic_flow_mL_per_s\n\
                         0,8,120,70,0\n1,131,90,128,400\n2,5,60,75,0\n";
        let indices = [
            index("EDP_mmHg", 8.0, 9.0),
            index("P_max_mmHg", 131.0, 120.0),
            index("EDV_mL", 120.0, 118.0),
            index("ESV_mL", 60.0, 57.0),
            index("SV_mL", 60.0, 61.0),
        ];
        let found = Traces::of(&predicted(simulated, &indices));
        assert_eq!(found.column("time_ms"), [0.0, 1.0, 2.0]);
        assert_eq!(found.column("pressure_mmHg")[..2], [9.0, 120.0]);
        assert_eq!(found.column("volume_mL"), [118.0, 87.5, 57.0]);
        assert_eq!(
            found.column("aortic_pressure_mmHg"),
            [70.0, 128.0, 75.0],
            "not predicted, so that it stays"
        );
        assert!((found.column("aortic_flow_mL_per_s")[1] - 400.0 * 61.0 / 60.0).abs() < 1e-6);
    }
}
