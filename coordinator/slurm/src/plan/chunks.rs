//! Packing of 0D work into chunks: one step on a node, or on a core, which runs its samples in one
//! process.

use std::ops::Range;

use super::{Choices, InUse, PlanError, check, check_time, longest_work_s, room, unit, walltime_s};
use crate::site::{Queue, Site, Unit};

/// Samples to compute, in blocks that must not be split: only a complete block of Saltelli's design
/// gives valid indices.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// Number of blocks that are still to be computed.
    pub n_blocks: u64,
    /// Number of samples in each block.
    pub samples_per_block: u64,
    /// Duration of a sample on one core, s.
    pub s_per_sample: f64,
}

/// Chunks of a sweep, all of the same size except the last.
#[derive(Debug, Clone, PartialEq)]
pub struct Chunks {
    /// Number of blocks in each chunk.
    pub blocks_per_chunk: u64,
    /// Number of chunks into which all blocks go.
    pub n_chunks: u64,
    /// Number of cores of each chunk.
    pub cores: u32,
    /// Walltime of each, s.
    pub walltime_s: u64,
    /// Expected duration of a full chunk, s.
    pub predicted_s: f64,
    /// Job arrays, or jobs of a single chunk on a site without arrays.
    pub arrays: Vec<ChunkArray>,
    /// Expected node-hours of all chunks.
    pub node_hours: f64,
    n_blocks: u64,
}

/// A job array with one element per chunk, or a single job of one chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChunkArray {
    /// Index of the chunk of element 0.
    pub first: u64,
    /// Number of elements with one chunk each; 1 for a single job.
    pub n: u32,
    /// Largest number of elements at once; `None` means no throttle.
    pub at_once: Option<u32>,
    /// Whether it belongs to this wave. Other jobs are submitted once earlier ones have ended.
    pub now: bool,
}

impl Chunks {
    /// Range of the blocks in a chunk.
    #[must_use]
    pub fn blocks(&self, chunk: u64) -> Range<u64> {
        let first = chunk
            .saturating_mul(self.blocks_per_chunk)
            .min(self.n_blocks);
        first
            ..first
                .saturating_add(self.blocks_per_chunk)
                .min(self.n_blocks)
    }
}

/// Packs a sweep into chunks with a duration of [`Choices::good_length_s`], or longer if the queue
/// takes only few jobs or a core of a node would be idle.
///
/// # Errors
/// [`PlanError`] if a block fits into no job of the queue, or a duration is not a positive number.
pub fn chunks(
    sweep: &Sweep,
    site: &Site,
    queue: &Queue,
    in_use: InUse,
    choices: &Choices,
) -> Result<Chunks, PlanError> {
    check(choices)?;
    check_time("time of a sample", sweep.s_per_sample)?;
    if sweep.samples_per_block == 0 {
        return Err(PlanError::Value {
            what: "samples of a block",
            found: 0.0,
            expected: "at least 1",
        });
    }
    let whole_nodes = unit(site, queue) == Unit::Node;
    let cores = if whole_nodes { site.node.cores } else { 1 };
    let room = room(queue, in_use);
    let fit = |seconds: f64| {
        ((seconds / sweep.s_per_sample).floor() as u64).saturating_mul(cores.into())
            / sweep.samples_per_block
    };
    let most = fit(longest_work_s(queue, choices));
    if most == 0 {
        let samples = sweep.samples_per_block;
        return Err(PlanError::DoesNotFit {
            task: format!("a block of {samples} samples"),
            needs: format!(
                "takes {:.0} s on {cores} cores",
                samples.div_ceil(cores.into()) as f64 * sweep.s_per_sample
            ),
            queue: queue.name.clone(),
            limit: format!("{:.0} s of work", longest_work_s(queue, choices)),
        });
    }
    // No charged core is left idle: a chunk has at least one sample per core, however short its job
    // becomes.
    let filled = u64::from(cores) / sweep.samples_per_block;
    let good = fit(choices.good_length_s as f64).max(filled).max(1);
    let fewest = sweep.n_blocks.div_ceil(u64::from(room.jobs.max(1)));
    let blocks_per_chunk = good.max(fewest).min(most).min(sweep.n_blocks.max(1));
    let n_chunks = sweep.n_blocks.div_ceil(blocks_per_chunk);
    let per_core = (blocks_per_chunk * sweep.samples_per_block).div_ceil(cores.into());
    let predicted_s = per_core as f64 * sweep.s_per_sample;

    let side_by_side = room
        .running
        .min(if whole_nodes {
            room.nodes
        } else {
            room.cores / cores
        })
        .max(1);
    let largest = if site.arrays.allowed {
        site.arrays.max_size.max(1)
    } else {
        1
    };
    let (mut arrays, mut first, mut jobs) = (Vec::new(), 0, room.jobs);
    while first < n_chunks {
        // The last array of this wave ends at the queue's limit.
        let limit = if jobs > 0 { largest.min(jobs) } else { largest };
        let n = u32::try_from(n_chunks - first)
            .unwrap_or(u32::MAX)
            .min(limit);
        let at_once = (n > side_by_side).then_some(side_by_side);
        arrays.push(ChunkArray {
            first,
            n,
            at_once,
            now: jobs > 0,
        });
        jobs = jobs.saturating_sub(n);
        first += u64::from(n);
    }
    let total =
        (sweep.n_blocks * sweep.samples_per_block) as f64 * sweep.s_per_sample / f64::from(cores);
    let node_hours = total.max(if n_chunks > 0 {
        sweep.s_per_sample
    } else {
        0.0
    }) / 3600.0
        * f64::from(cores)
        / f64::from(site.node.cores);
    let walltime_s = walltime_s(predicted_s, queue, choices);
    Ok(Chunks {
        blocks_per_chunk,
        n_chunks,
        cores,
        walltime_s,
        predicted_s,
        arrays,
        node_hours,
        n_blocks: sweep.n_blocks,
    })
}
