//! Division of a record into parts that are held out of a fit in turn.

use super::record::Record;
use cardiotwin_vocabulary::statistics::EffectiveSampleSize;

/// Largest number of parts.
const MOST_FOLDS: usize = 5;
/// Number of parts of a record with few beats.
const BLOCK_FOLDS: usize = 4;
/// Shortest block \[ms\]; a block also spans at least three correlation times of the residuals.
const SHORTEST_BLOCK_MS: f64 = 40.0;

/// Division of a record into folds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Folds {
    /// Fold of each sample.
    pub(super) of: Vec<usize>,
    pub(super) n: usize,
    /// Whether folds are whole beats, rather than blocks within a beat.
    pub(super) by_beat: bool,
}

impl Folds {
    /// Divides the record by beats if there are at least three, else by blocks within the beat.
    pub(super) fn new(record: &Record, sample_size: &EffectiveSampleSize) -> Self {
        let time = &record.pressure_time_s;
        if record.n_beats() >= 3 {
            let n = record.n_beats().min(MOST_FOLDS);
            return Self {
                of: time.iter().map(|t| record.beat_of(*t) % n).collect(),
                n,
                by_beat: true,
            };
        }
        let length_ms = 1e3 * (time[time.len() - 1] - time[0]);
        let block = SHORTEST_BLOCK_MS.max(3.0 * sample_size.correlation_time_ms);
        let n_blocks = ((length_ms / block).floor() as usize).max(BLOCK_FOLDS);
        let width = 1e-3 * length_ms / n_blocks as f64;
        let of = time
            .iter()
            .map(|t| (((t - time[0]) / width) as usize).min(n_blocks - 1) % BLOCK_FOLDS)
            .collect();
        Self {
            of,
            n: BLOCK_FOLDS,
            by_beat: false,
        }
    }

    /// Samples that enter the fit while this fold is held out.
    pub(super) fn seen(&self, fold: usize) -> Vec<bool> {
        self.of.iter().map(|f| *f != fold).collect()
    }
}
