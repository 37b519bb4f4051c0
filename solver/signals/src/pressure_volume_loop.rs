//! Work of the ventricle in a beat.

/// Work of one mmHg·mL \[mJ\].
const MJ_PER_MMHG_ML: f64 = 0.133_322_4;

/// Stroke work \[mJ\]: the area of the loop that the points make, closed from the last to the
/// first; `None` for fewer than three points.
#[must_use]
pub fn stroke_work_mj(volume_ml: &[f64], pressure_mmhg: &[f64]) -> Option<f64> {
    stroke_work_mmhg_ml(volume_ml, pressure_mmhg).map(|area| MJ_PER_MMHG_ML * area)
}

/// The same work \[mmHg mL\]; `None` for fewer than three points.
#[must_use]
pub fn stroke_work_mmhg_ml(volume_ml: &[f64], pressure_mmhg: &[f64]) -> Option<f64> {
    let n = volume_ml.len().min(pressure_mmhg.len());
    let area: f64 = (0..n)
        .map(|i| {
            let next = (i + 1) % n;
            0.5 * (pressure_mmhg[i] + pressure_mmhg[next]) * (volume_ml[i] - volume_ml[next])
        })
        .sum();
    (n > 2).then_some(area)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_work_of_a_rectangle_is_its_area() {
        // 100 mmHg over 70 mL out, nothing over 70 mL in.
        let pressure = [10.0, 110.0, 110.0, 10.0];
        let volume = [120.0, 120.0, 50.0, 50.0];
        let work = stroke_work_mj(&volume, &pressure).unwrap();
        assert!(
            (work - 100.0 * 70.0 * MJ_PER_MMHG_ML).abs() < 1e-9,
            "{work}"
        );
        assert_eq!(stroke_work_mj(&volume[..2], &pressure), None);
    }
}
