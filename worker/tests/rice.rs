//! `cardiotwin fit calcium` has its own implementation of Rice's transient; it must agree with the
//! models' curve.

use cardiotwin_calibrate::calcium_fit::RiceParameters;
use cardiotwin_models::calcium::{Calcium as _, Rice2008, Rice2008Parameters};

#[test]
fn the_fitted_curve_is_the_models() {
    let times: Vec<f64> = (-5..200).map(|i| 7.5 * f64::from(i)).collect();
    for (tau_cr_ms, tau_cd_ms) in [
        (129.0, 128.0),
        (128.0, 129.0),
        (130.0, 130.0),
        (192.5, 26.0),
        (60.0, 60.0 + 1e-9),
    ] {
        let (ca_res_um, ca_max_um) = (0.12, 0.7);
        let fitted = RiceParameters {
            ca_res_um,
            ca_max_um,
            tau_cr_ms,
            tau_cd_ms,
        }
        .transient_um(&times);
        let model = Rice2008::new(Rice2008Parameters {
            ca_res_um,
            ca_max_um,
            tau_cr_ms,
            tau_cd_ms,
        })
        .unwrap();
        for (s, fitted) in times.iter().zip(fitted) {
            assert!(
                (fitted - model.concentration_um(*s)).abs() < 1e-14,
                "{tau_cr_ms} {tau_cd_ms} {s}"
            );
        }
    }
}
