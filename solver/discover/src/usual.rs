//! Usual uncertainties of measurements whose files state none.

use cardiotwin_vocabulary::measurements::FurtherQuantity;

/// Correlation time of the noise of a trace \[ms\].
pub const CORRELATION_MS: f64 = 10.0;
/// Standard deviation of the time of a valve \[ms\]: half of a frame of an echo with 100 frames a
/// second.
pub const VALVE_SD_MS: f64 = 5.0;
/// Standard deviation of a duration of QRS \[ms\]: a tenth of a millimetre at 25 mm/s.
pub const QRS_SD_MS: f64 = 4.0;
/// Standard deviation of a cuff pressure without a stated uncertainty \[mmHg\].
pub const CUFF_SD_MMHG: f64 = 4.0;
/// Relative standard deviation of a stroke volume from flow imaging.
pub const STROKE_VOLUME_SD: f64 = 0.07;
/// Relative standard deviation of the whole-heart volume.
pub const IMAGE_SD: f64 = 0.04;

/// Rms of the noise of a further trace, in the unit of its quantity: a catheter with fluid, flow MRI
/// of one heart beat in a frame, speckle tracking of one segment.
#[must_use]
pub fn trace_rms(quantity: FurtherQuantity) -> f64 {
    match quantity {
        FurtherQuantity::AorticPressure
        | FurtherQuantity::AtrialPressure
        | FurtherQuantity::Strain => 1.0,
        FurtherQuantity::AorticFlow | FurtherQuantity::MitralFlow => 15.0,
    }
}
