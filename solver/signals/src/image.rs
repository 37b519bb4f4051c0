//! Which state of the cavity an image shows, by measured volumes and pressures.

use cardiotwin_units::{Ml, Mmhg};

/// Unloaded volume after Klotz 2006: V0 = EDV (0.6 − 0.006 EDP), EDP in mmHg. The rule was read in
/// public programs.
#[must_use]
pub fn klotz_unloaded_volume(end_diastolic_volume: Ml, end_diastolic_pressure: Mmhg) -> Ml {
    Ml(end_diastolic_volume.0 * (0.6 - 0.006 * end_diastolic_pressure.0))
}

/// Whether an image with this volume and pressure lies on the way of filling: above the unloaded volume, before end-diastole.
/// An image that does not is taken to show end-diastole.
#[must_use]
pub fn is_before_end_diastole(image: (Ml, Mmhg), end_diastole: (Ml, Mmhg)) -> bool {
    let ((volume, pressure), (end_volume, end_pressure)) = (image, end_diastole);
    let filling = pressure.0 > 0.0 && pressure.0 < end_pressure.0;
    filling
        && volume.0 < end_volume.0
        && volume.0 > klotz_unloaded_volume(end_volume, end_pressure).0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_of_diastasis_lies_between_the_unloaded_volume_and_end_diastole() {
        let end = (Ml(120.0), Mmhg(10.0));
        assert_eq!(klotz_unloaded_volume(end.0, end.1), Ml(120.0 * 0.54));
        assert!(is_before_end_diastole((Ml(100.0), Mmhg(6.0)), end));
        assert!(
            !is_before_end_diastole((Ml(60.0), Mmhg(6.0)), end),
            "below the unloaded volume"
        );
        assert!(
            !is_before_end_diastole((Ml(121.0), Mmhg(6.0)), end),
            "above end-diastole"
        );
        assert!(
            !is_before_end_diastole((Ml(100.0), Mmhg(12.0)), end),
            "above the end-diastolic pressure"
        );
        assert!(
            !is_before_end_diastole((Ml(100.0), Mmhg(-1.0)), end),
            "suction"
        );
    }
}
