//! Projection of positions in the heart onto the plane of the picture.

/// A point or a direction in space.
pub type Vec3 = [f64; 3];

pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub fn unit(a: Vec3) -> Vec3 {
    let length = dot(a, a).sqrt();
    if length > 0.0 {
        a.map(|x| x / length)
    } else {
        a
    }
}

/// Angle by which the viewer looks down on the cut \[degrees\].
const ELEVATION_DEG: f64 = 16.0;
/// Angle by which the viewer stands to the right of straight ahead \[degrees\].
const AZIMUTH_DEG: f64 = 10.0;

/// A parallel projection. Right, up and towards the viewer are perpendicular unit vectors.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    right: Vec3,
    up: Vec3,
    towards: Vec3,
}

impl Camera {
    /// A camera in front of a cut, a little above and to the side, with the base up.
    pub fn of(long_axis: Vec3, front: Vec3) -> Self {
        let up = unit(long_axis);
        let right = unit(cross(up, front));
        let front = cross(right, up);
        let (e, a) = (ELEVATION_DEG.to_radians(), AZIMUTH_DEG.to_radians());
        let towards: Vec3 = std::array::from_fn(|i| {
            e.cos() * (a.cos() * front[i] + a.sin() * right[i]) + e.sin() * up[i]
        });
        let right = unit(cross(up, towards));
        Self {
            right,
            up: cross(towards, right),
            towards,
        }
    }

    /// Coordinates of `x` to the right, upwards and towards the viewer.
    pub fn see(&self, x: Vec3) -> Vec3 {
        [dot(x, self.right), dot(x, self.up), dot(x, self.towards)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_base_is_up_and_the_viewer_in_front() {
        let camera = Camera::of([0.0, 0.0, 2.0], [0.0, -1.0, 0.0]);
        let [x, y, z] = camera.see([0.0, 0.0, 1.0]);
        assert!(x.abs() < 1e-12 && y > 0.9 && z > 0.0);
        assert!(camera.see([1.0, 0.0, 0.0])[0] > 0.9 && camera.see([0.0, -1.0, 0.0])[2] > 0.9);
        // The projection preserves distances.
        let p = [0.3, -1.2, 2.0];
        assert!((dot(camera.see(p), camera.see(p)) - dot(p, p)).abs() < 1e-12);
    }
}
