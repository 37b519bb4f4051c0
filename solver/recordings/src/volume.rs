//! The cine volumes brought to the volume of the whole-heart image, which shows the cavity once, but finely.

use crate::cine::Cine;

/// The whole-heart image's volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WholeHeart {
    /// Time at which it was taken, ms on the cine's clock: from the trigger, in the cine's cycle.
    pub time_ms: f64,
    /// Cavity volume, mL.
    pub volume_ml: f64,
    /// Its standard deviation, mL.
    pub sd_ml: Option<f64>,
}

/// How volumes are brought to it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Adjust {
    /// By a factor: what a wrong thickness or gap of slices does. The ejection fraction stays.
    #[default]
    Scale,
    /// By a shift: what a basal slice too many or too few does. The stroke volume stays.
    Shift,
    /// By a factor that is given.
    By(f64),
    /// Not at all.
    Off,
}

/// What was done.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjusted {
    /// The frames after it.
    pub cine: Cine,
    /// The frames' volume at the image's time before it, mL; none without an image.
    pub before_ml: Option<f64>,
    /// Factor on all volumes.
    pub factor: f64,
    /// Shift of all volumes, mL.
    pub shift_ml: f64,
}

/// Brings the frames to the image's volume; without an image they stay, unless a factor is given.
#[must_use]
pub fn adjust(cine: &Cine, image: Option<&WholeHeart>, how: Adjust) -> Adjusted {
    let before_ml = image.map(|image| cine.near(image.time_ms));
    let (factor, shift_ml) = match (how, image, before_ml) {
        (Adjust::By(factor), ..) => (factor, 0.0),
        (Adjust::Scale, Some(image), Some(before)) => (image.volume_ml / before, 0.0),
        (Adjust::Shift, Some(image), Some(before)) => (1.0, image.volume_ml - before),
        _ => (1.0, 0.0),
    };
    let mut cine = cine.clone();
    cine.volume_ml
        .iter_mut()
        .for_each(|v| *v = factor * *v + shift_ml);
    Adjusted {
        cine,
        before_ml,
        factor,
        shift_ml,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_meet_the_image_and_keep_what_they_should() {
        let time: Vec<f64> = (0..25).map(|i| f64::from(i) * 32.0).collect();
        let volume = time
            .iter()
            .map(|t| 120.0 + 40.0 * (t / 800.0 * std::f64::consts::TAU).cos())
            .collect();
        let cine = Cine::new(time, volume, Some(800.0)).unwrap();
        let image = WholeHeart {
            time_ms: 640.0,
            volume_ml: 140.0,
            sd_ml: None,
        };
        let fraction =
            |c: &Cine| c.stroke_volume_ml() / c.volume_ml.iter().copied().fold(0.0, f64::max);
        let scaled = adjust(&cine, Some(&image), Adjust::Scale);
        assert!((scaled.cine.near(640.0) - 140.0).abs() < 1e-9 && scaled.factor > 1.0);
        assert!((fraction(&scaled.cine) - fraction(&cine)).abs() < 1e-12);
        let shifted = adjust(&cine, Some(&image), Adjust::Shift);
        assert!((shifted.cine.near(640.0) - 140.0).abs() < 1e-9);
        assert!((shifted.cine.stroke_volume_ml() - cine.stroke_volume_ml()).abs() < 1e-9);
        assert_eq!(adjust(&cine, Some(&image), Adjust::Off).cine, cine);
        assert_eq!(adjust(&cine, None, Adjust::By(2.0)).factor, 2.0);
        assert_eq!(adjust(&cine, None, Adjust::Scale).cine, cine);
    }
}
