//! Choice of the instructions that run the lanes, at run time or by a setting.

use serde::{Deserialize, Serialize};

use crate::calcium::SampledCalcium;
use crate::input::ConstantLanes;
use crate::start::{Prepared, StartTimeLanes, prepare};
use crate::step::{Lanes, step};

/// An instruction set that the lanes can be run with. [`SimdPath::Avx2`] and [`SimdPath::Avx512`] give the same bits;
/// [`SimdPath::Portable`] rounds products before sums and so differs from them by rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SimdPath {
    /// Instructions of every target of the compiler, without fused multiply-add.
    Portable,
    /// Four lanes a register, with fused multiply-add.
    Avx2,
    /// Eight lanes a register, with fused multiply-add.
    Avx512,
}

/// A setting asks for a path that this processor does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "this processor does not support the {wanted:?} path: use {best:?} or leave the path unset"
)]
pub struct PathMissing {
    /// Path that the setting asks for.
    pub wanted: SimdPath,
    /// Best path of this processor.
    pub best: SimdPath,
}

impl SimdPath {
    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("fma")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The fastest that this processor has.
    #[must_use]
    pub fn best() -> Self {
        [Self::Avx512, Self::Avx2]
            .into_iter()
            .find(|path| path.is_available())
            .unwrap_or(Self::Portable)
    }
}

/// A path that this processor has: the only way to the vector functions, which makes their call sound.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Available(SimdPath);

impl Available {
    /// The pinned path, or the best one.
    ///
    /// # Errors
    /// [`PathMissing`] when the pinned one is not available.
    pub fn choose(pinned: Option<SimdPath>) -> Result<Self, PathMissing> {
        match pinned {
            None => Ok(Self(SimdPath::best())),
            Some(path) if path.is_available() => Ok(Self(path)),
            Some(wanted) => Err(PathMissing {
                wanted,
                best: SimdPath::best(),
            }),
        }
    }

    /// Path by its public name.
    pub fn path(self) -> SimdPath {
        self.0
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{ConstantLanes, Lanes, Prepared, SampledCalcium, StartTimeLanes, prepare, step};

    #[target_feature(enable = "avx2,fma")]
    pub fn step_avx2(lanes: &mut Lanes, samples: Option<&SampledCalcium>) {
        step::<true>(lanes, samples);
    }

    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma")]
    pub fn step_avx512(lanes: &mut Lanes, samples: Option<&SampledCalcium>) {
        step::<true>(lanes, samples);
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn prepare_avx2(
        constants: &ConstantLanes,
        start: &StartTimeLanes,
        prepared: &mut Prepared,
    ) {
        prepare::<true>(constants, start, prepared);
    }

    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma")]
    pub fn prepare_avx512(
        constants: &ConstantLanes,
        start: &StartTimeLanes,
        prepared: &mut Prepared,
    ) {
        prepare::<true>(constants, start, prepared);
    }
}

/// Tries one step in every lane.
#[cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "functions with target features may only be called where the features are known"
    )
)]
pub(crate) fn step_lanes(path: Available, lanes: &mut Lanes, samples: Option<&SampledCalcium>) {
    match path.0 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `Available` path exists only where the processor has its features.
        SimdPath::Avx512 => unsafe { x86::step_avx512(lanes, samples) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        SimdPath::Avx2 => unsafe { x86::step_avx2(lanes, samples) },
        _ => step::<false>(lanes, samples),
    }
}

/// Prepares every lane with the instructions of `path`.
#[cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "functions with target features may only be called where the features are known"
    )
)]
pub(crate) fn prepare_lanes(
    path: Available,
    constants: &ConstantLanes,
    start: &StartTimeLanes,
    prepared: &mut Prepared,
) {
    match path.0 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `Available` path exists only where the processor has its features.
        SimdPath::Avx512 => unsafe { x86::prepare_avx512(constants, start, prepared) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        SimdPath::Avx2 => unsafe { x86::prepare_avx2(constants, start, prepared) },
        _ => prepare::<false>(constants, start, prepared),
    }
}
