//! Elastance of the arteries as the ventricle meets them.

use super::beat::Beat;
use super::end_systole::EndSystole;

/// Effective arterial elastance Ea = Pes/SV \[mmHg/mL\].
///
/// Source: Kelly et al. 1992, Circulation 86:513, "the simple ratio of ventricular end-systolic pressure to stroke
/// volume" (abstract).
#[must_use]
pub fn arterial_elastance_mmhg_per_ml(beat: &Beat, end_systole: EndSystole) -> f64 {
    end_systole.pressure_mmhg / beat.stroke_volume_ml()
}

#[cfg(test)]
mod tests {
    use super::super::end_systole::end_systole;
    use super::super::model_heart::Heart;
    use super::*;

    /// Segers et al. 2002, Am J Physiol 282:H1041 (abstract): Ea = −0.13 + 1.02 R/T + 0.31/C of model hearts in the
    /// human range. Their valves and elastance differ, so 15 % is allowed; this heart is above by up to 12 %.
    #[test]
    fn a_windkessel_has_the_elastance_of_the_published_regression() {
        for (peripheral, compliance) in [(0.8, 1.5), (1.1, 1.2), (1.5, 0.9)] {
            let heart = Heart {
                peripheral_mmhg_s_per_ml: peripheral,
                compliance_ml_per_mmhg: compliance,
                ..Heart::default()
            };
            let beat = heart.beat();
            let point = end_systole(&beat, heart.intercept_ml).unwrap();
            let found = arterial_elastance_mmhg_per_ml(&beat, point);
            let published = -0.13 + 1.02 * peripheral / 0.8 + 0.31 / compliance;
            assert!(
                (found / published - 1.0).abs() < 0.15,
                "{found} {published}"
            );
        }
    }
}
