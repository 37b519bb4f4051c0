//! Settings of the steps from `[steps]` of `prepare.toml`.

use cardiotwin_recordings::average::AverageSettings;
use cardiotwin_recordings::beats::{BeatSettings, Source};
use cardiotwin_recordings::cycle::CycleSettings;
use cardiotwin_recordings::drift::{DriftSettings, Reference};
use cardiotwin_recordings::prepare::Settings;
use cardiotwin_recordings::reject::RejectSettings;
use cardiotwin_recordings::synchronise::SynchroniseSettings;
use cardiotwin_recordings::volume::{Adjust, WholeHeart};
use cardiotwin_schemas::raw::{BeatSource, RawFile, RawSteps, VolumeAdjustment, ZeroAt};

/// Settings of all steps.
pub fn of(steps: &RawSteps) -> Settings {
    let numbers = |list: &[u32]| list.iter().map(|number| *number as usize).collect();
    Settings {
        beats: BeatSettings {
            source: steps.beats.source.map(|source| match source {
                BeatSource::RWave => Source::RWave,
                BeatSource::PressureRise => Source::PressureRise,
                BeatSource::Given => Source::Given,
            }),
            onsets_ms: steps.beats.onsets_ms.clone(),
        },
        reject: RejectSettings {
            enabled: steps.reject.enabled,
            keep: numbers(&steps.reject.keep),
            leave_out: numbers(&steps.reject.leave_out),
            leave_out_ms: steps.reject.leave_out_ms.clone(),
        },
        drift: DriftSettings {
            enabled: steps.drift.enabled,
            reference: match steps.drift.zero_at {
                ZeroAt::Begin => Reference::Begin,
                ZeroAt::Middle => Reference::Middle,
                ZeroAt::End => Reference::End,
            },
        },
        average: AverageSettings {
            enabled: steps.average.enabled,
            align: steps.average.align,
            cycle_length_ms: steps.average.cycle_length_ms,
            beat: steps.average.beat.map(|number| number as usize),
        },
        volume: match (
            steps.volume.enabled,
            steps.volume.factor,
            steps.volume.adjust,
        ) {
            (false, ..) => Adjust::Off,
            (true, Some(factor), _) => Adjust::By(factor),
            (true, None, VolumeAdjustment::Scale) => Adjust::Scale,
            (true, None, VolumeAdjustment::Shift) => Adjust::Shift,
        },
        cycle: CycleSettings {
            enabled: steps.cycle.enabled,
            systole_factor: steps.cycle.systole_factor,
        },
        synchronise: SynchroniseSettings {
            enabled: steps.synchronise.enabled,
            lag_ms: steps.synchronise.lag_ms,
        },
    }
}

/// The whole-heart image, if `prepare.toml` has one.
pub fn whole_heart(file: &RawFile) -> Option<WholeHeart> {
    let image = file.whole_heart.as_ref()?;
    Some(WholeHeart {
        time_ms: image.time_ms,
        volume_ml: image.volume_ml,
        sd_ml: image.sd_ml,
    })
}
