//! Rises of a pressure, by which beats are counted before anything else is known of it.

/// Shares of the pressure's range below and above which it must have been for a rise.
const RISE: [f64; 2] = [0.3, 0.6];

/// Indices at which the pressure has risen through its range.
pub(super) fn rises(pressure: &[f64]) -> Vec<usize> {
    let (low, high) = ends(pressure);
    let [below, above] = RISE.map(|share| low + share * (high - low));
    let mut was_low = false;
    let mut found = Vec::new();
    for (i, p) in pressure.iter().enumerate() {
        if *p < below {
            was_low = true;
        } else if *p > above && was_low {
            was_low = false;
            found.push(i);
        }
    }
    found
}

/// Smallest and largest finite value.
pub(super) fn ends(values: &[f64]) -> (f64, f64) {
    let finite = values.iter().filter(|v| v.is_finite());
    finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(*v), high.max(*v))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rise_goes_through_the_range_and_a_ripple_does_not() {
        let pressure = [
            50.0,
            5.0,
            8.0,
            40.0,
            90.0,
            70.0,
            95.0,
            4.0,
            f64::NAN,
            9.0,
            100.0,
        ];
        assert_eq!(rises(&pressure), [4, 10]);
        assert_eq!(rises(&[7.0, 7.0]), Vec::<usize>::new());
    }
}
