//! Tasks of a sensitivity sweep. Each consists of complete blocks, so that the first chunks are a
//! design of their own.

use std::ops::Range;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::sweep::GsaSpec;
use cardiotwin_schemas::task::{CellSweepSpec, TaskSpec};

/// Members of the sweep's run in the design's order.
#[must_use]
pub fn members(spec: &GsaSpec) -> Vec<ResolvedPatient> {
    let step = spec.chunk_blocks.max(1);
    (0..spec.n_blocks)
        .step_by(step as usize)
        .map(|first_block| {
            let n_blocks = step.min(spec.n_blocks - first_block);
            let task = CellSweepSpec {
                design: spec.design.clone(),
                first_block,
                n_blocks,
            };
            let id = PatientId(name(first_block..first_block + n_blocks));
            ResolvedPatient::without_data(
                id,
                Workflow::Task {
                    task: Box::new(TaskSpec::CellSweep(Box::new(task))),
                },
            )
        })
        .collect()
}

/// Id of a chunk, such as `blocks-0064-0127`.
fn name(blocks: Range<u32>) -> String {
    format!("blocks-{:04}-{:04}", blocks.start, blocks.end - 1)
}

/// Blocks that a member computes; `None` if the member is not a chunk.
#[must_use]
pub fn blocks(member: &ResolvedPatient) -> Option<Range<u32>> {
    let Workflow::Task { task } = &member.workflow else {
        return None;
    };
    let TaskSpec::CellSweep(spec) = task.as_ref() else {
        return None;
    };
    Some(spec.first_block..spec.first_block + spec.n_blocks)
}

#[cfg(test)]
mod tests {
    use super::super::spec::published;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Chunks are complete blocks without gap or overlap, and a longer design contains the full
        /// chunks of the shorter one.
        #[test]
        fn chunks_cover_the_design(n_blocks in 2u32..300, chunk_blocks in 1u32..80, more in 0u32..100) {
            let spec = GsaSpec { n_blocks, chunk_blocks, ..published() };
            let chunks = members(&spec);
            let ranges: Vec<_> = chunks.iter().map(|member| blocks(member).unwrap()).collect();
            prop_assert_eq!((ranges[0].start, ranges[ranges.len() - 1].end), (0, n_blocks));
            prop_assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start));
            let longer = members(&GsaSpec { n_blocks: n_blocks + more, ..spec });
            for (short, long) in chunks.iter().zip(&longer).take((n_blocks / chunk_blocks) as usize) {
                prop_assert_eq!(short, long);
            }
        }
    }
}
