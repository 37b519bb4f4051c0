//! Vectors of three numbers as plain arrays.

/// A point in mm, or a direction.
pub type Vec3 = [f64; 3];

/// Sum of two vectors, a + b.
#[inline]
#[must_use]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Difference of two vectors, a − b.
#[inline]
#[must_use]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Product of a vector with a number, s a.
#[inline]
#[must_use]
pub fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// a + s b
#[inline]
#[must_use]
pub fn axpy(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// Scalar product a · b.
#[inline]
#[must_use]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product a × b.
#[inline]
#[must_use]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Euclidean length |a|.
#[inline]
#[must_use]
pub fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// Distance of two points, |a − b|.
#[inline]
#[must_use]
pub fn distance(a: Vec3, b: Vec3) -> f64 {
    norm(sub(a, b))
}

/// a / |a|; `None` if |a| is zero or not finite.
#[inline]
#[must_use]
pub fn unit(a: Vec3) -> Option<Vec3> {
    let length = norm(a);
    (length > 0.0 && length.is_finite()).then(|| scale(a, 1.0 / length))
}

/// Component of `a` perpendicular to the unit vector `n`.
#[inline]
#[must_use]
pub fn reject(a: Vec3, n: Vec3) -> Vec3 {
    axpy(a, -dot(a, n), n)
}

/// A unit vector perpendicular to the unit vector `n`, always the same one for the same `n`.
#[inline]
#[must_use]
pub fn any_perpendicular(n: Vec3) -> Vec3 {
    let smallest = (0..3)
        .min_by(|i, j| n[*i].abs().total_cmp(&n[*j].abs()))
        .unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[smallest] = 1.0;
    let across = cross(n, axis);
    scale(across, 1.0 / norm(across))
}
