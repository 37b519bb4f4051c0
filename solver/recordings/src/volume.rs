//! Adjustment of the cine volumes to the volume in the whole-heart image, which shows the cavity
//! only once but with high resolution.

use cardiotwin_vocabulary::preparation::{RawImage, VolumeAdjustment, VolumeStep};

use crate::cine::Cine;

/// Result of the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjusted {
    /// Frames after the adjustment.
    pub cine: Cine,
    /// Volume of the frames at the image's time before the adjustment \[mL\]; `None` without an
    /// image.
    pub before_ml: Option<f64>,
    /// Factor of all volumes.
    pub factor: f64,
    /// Shift of all volumes \[mL\].
    pub shift_ml: f64,
}

/// Adjusts the frames to the image's volume. Without an image they stay unchanged, unless a factor
/// is given.
#[must_use]
pub fn adjust(cine: &Cine, image: Option<&RawImage>, settings: VolumeStep) -> Adjusted {
    let before_ml = image.map(|image| cine.near(image.time_ms));
    let (factor, shift_ml) = match (settings.factor, image, before_ml) {
        _ if !settings.enabled => (1.0, 0.0),
        (Some(factor), ..) => (factor, 0.0),
        (None, Some(image), Some(before)) => match settings.adjust {
            VolumeAdjustment::Scale => (image.volume_ml / before, 0.0),
            VolumeAdjustment::Shift => (1.0, image.volume_ml - before),
        },
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
        let image = RawImage {
            time_ms: 640.0,
            volume_ml: 140.0,
            sd_ml: None,
        };
        let fraction =
            |c: &Cine| c.stroke_volume_ml() / c.volume_ml.iter().copied().fold(0.0, f64::max);
        let scale = VolumeStep::default();
        let scaled = adjust(&cine, Some(&image), scale);
        assert!((scaled.cine.near(640.0) - 140.0).abs() < 1e-9 && scaled.factor > 1.0);
        assert!((fraction(&scaled.cine) - fraction(&cine)).abs() < 1e-12);
        let shift = VolumeStep {
            adjust: VolumeAdjustment::Shift,
            ..scale
        };
        let shifted = adjust(&cine, Some(&image), shift);
        assert!((shifted.cine.near(640.0) - 140.0).abs() < 1e-9);
        assert!((shifted.cine.stroke_volume_ml() - cine.stroke_volume_ml()).abs() < 1e-9);
        let off = VolumeStep {
            enabled: false,
            factor: Some(2.0),
            ..scale
        };
        assert_eq!(adjust(&cine, Some(&image), off).cine, cine);
        let given = VolumeStep {
            factor: Some(2.0),
            ..scale
        };
        assert_eq!(adjust(&cine, None, given).factor, 2.0);
        assert_eq!(adjust(&cine, None, scale).cine, cine);
    }
}
