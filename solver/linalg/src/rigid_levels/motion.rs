//! Rigid motions of groups of nodes. A motion is a translation \[mm\] and a rotation, and its dual a force and a moment, about the
//! origin or about a group's centre.

use crate::conjugate_gradients::Entry;

/// Six numbers: a translation and a rotation, or a force and a moment.
pub(super) type Six = [f64; 6];
/// A 6×6 matrix, row-major.
pub(super) type Block6 = [f64; 36];

pub(super) fn cross<T: Entry>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn halves(v: &Six) -> ([f64; 3], [f64; 3]) {
    ([v[0], v[1], v[2]], [v[3], v[4], v[5]])
}

/// Force and moment about `centre`, of those about the origin.
pub(super) fn moment_about(centre: [f64; 3], about_origin: &Six) -> Six {
    let (f, m) = halves(about_origin);
    let shift = cross(centre, f);
    [
        f[0],
        f[1],
        f[2],
        m[0] - shift[0],
        m[1] - shift[1],
        m[2] - shift[2],
    ]
}

/// Motion about the origin, of one about `centre`.
pub(super) fn motion_about_origin(centre: [f64; 3], about_centre: &Six) -> Six {
    let (t, w) = halves(about_centre);
    let shift = cross(w, centre);
    [
        t[0] - shift[0],
        t[1] - shift[1],
        t[2] - shift[2],
        w[0],
        w[1],
        w[2],
    ]
}

/// The same stiffness for motions about centres of their own, of one for motions about the origin.
pub(super) fn stiffness_about(row: [f64; 3], column: [f64; 3], about_origin: &Block6) -> Block6 {
    let mut half = [0.0; 36];
    for j in 0..6 {
        // A unit motion about the column's centre is a motion about the origin.
        let mut unit = [0.0; 6];
        unit[j] = 1.0;
        let motion = motion_about_origin(column, &unit);
        for i in 0..6 {
            half[6 * i + j] = (0..6).map(|k| about_origin[6 * i + k] * motion[k]).sum();
        }
    }
    let mut out = [0.0; 36];
    for j in 0..6 {
        let force = moment_about(row, &std::array::from_fn(|i| half[6 * i + j]));
        for i in 0..6 {
            out[6 * i + j] = force[i];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energy_does_not_depend_on_the_centre() {
        let about_origin: Block6 = std::array::from_fn(|k| ((7 * k + 3) as f64).sin());
        let (a, b) = ([1.0, -2.0, 0.5], [3.0, 0.2, -1.0]);
        let (x, y) = (
            [0.3, 1.0, -0.4, 0.2, 0.7, -0.1],
            [1.0, 0.1, 0.6, -0.5, 0.4, 0.9],
        );
        let energy = |k: &Block6, x: &Six, y: &Six| -> f64 {
            (0..6)
                .flat_map(|i| (0..6).map(move |j| x[i] * k[6 * i + j] * y[j]))
                .sum()
        };
        let centred = stiffness_about(a, b, &about_origin);
        let (from_a, from_b) = (motion_about_origin(a, &x), motion_about_origin(b, &y));
        let (one, other) = (
            energy(&centred, &x, &y),
            energy(&about_origin, &from_a, &from_b),
        );
        assert!((one - other).abs() < 1e-12, "{one} {other}");
    }
}
