use std::collections::BTreeSet;

use proptest::prelude::*;

use super::{
    Choices, InUse, PlanError, Simulation, Sweep, bundles, chunks, finish, longest_work_s,
};
use crate::site::tests::shipped as site;
use crate::site::{Queue, Site, Use};

fn queue(site: &Site, name: &str) -> Queue {
    site.queue(Some(name), Use::Simulations)
        .expect("a queue")
        .clone()
}

fn simulations(times: &[f64], ranks: u32) -> Vec<Simulation> {
    let simulation = |(i, predicted_s): (usize, &f64)| Simulation {
        task: format!("t{i:04}"),
        ranks,
        predicted_s: *predicted_s,
        has_checkpoints: true,
    };
    times.iter().enumerate().map(simulation).collect()
}

/// 256 simulations of one node under taskfarm: all 256 nodes of a user at once, in bundles of 16.
#[test]
fn a_cohort_on_archer2() {
    let site = site("archer2");
    let taskfarm = queue(&site, "taskfarm");
    let plan = bundles(
        &simulations(&[4000.0; 256], 128),
        &site,
        &taskfarm,
        InUse::default(),
        &Choices::default(),
    );
    let plan = plan.expect("a plan");
    assert_eq!(
        (plan.len(), plan[0].n_nodes, plan[0].nodes_per_step),
        (16, 16, 1)
    );
    let jobs = plan
        .iter()
        .map(|bundle| (bundle.n_nodes, bundle.predicted_s()))
        .collect::<Vec<_>>();
    assert_eq!(finish(&jobs, &taskfarm, InUse::default()).after_s, 4000.0);
    let hours = plan.iter().map(|bundle| bundle.node_hours).sum::<f64>();
    assert!((hours - 256.0 * 4000.0 / 3600.0).abs() < 1e-9);
}

/// The paper's Sobol analysis at 1 s per sample: 352 rounds on a node's cores, hence one job of one
/// node.
#[test]
fn the_sobol_analysis_on_archer2() {
    let site = site("archer2");
    let taskfarm = queue(&site, "taskfarm");
    let sweep = Sweep {
        n_blocks: 2048,
        samples_per_block: 22,
        s_per_sample: 1.0,
    };
    let plan = chunks(
        &sweep,
        &site,
        &taskfarm,
        InUse::default(),
        &Choices::default(),
    )
    .expect("a plan");
    assert_eq!(
        (
            plan.n_chunks,
            plan.cores,
            plan.arrays.len(),
            plan.arrays[0].n
        ),
        (1, 128, 1, 1)
    );
    assert_eq!(plan.predicted_s, 352.0);
    assert!((plan.node_hours - 352.0 / 3600.0).abs() < 1e-9);
    // At a hundred times the duration it takes about ten jobs of an hour.
    let slow = Sweep {
        s_per_sample: 100.0,
        ..sweep
    };
    let plan = chunks(
        &slow,
        &site,
        &taskfarm,
        InUse::default(),
        &Choices::default(),
    )
    .expect("a plan");
    assert_eq!((plan.n_chunks, plan.blocks_per_chunk), (10, 209));
}

#[test]
fn what_fits_nowhere_is_named() {
    let site = site("archer2");
    let taskfarm = queue(&site, "taskfarm");
    let wide = simulations(&[100.0], 128 * 17);
    let error = bundles(
        &wide,
        &site,
        &taskfarm,
        InUse::default(),
        &Choices::default(),
    )
    .expect_err("17 nodes of 16");
    assert!(
        error
            .to_string()
            .contains("t0000 needs 17 nodes, queue 'taskfarm' gives 16"),
        "{error}"
    );
    let mut long = simulations(&[1e6], 128);
    assert!(
        bundles(
            &long,
            &site,
            &taskfarm,
            InUse::default(),
            &Choices::default()
        )
        .is_ok(),
        "it goes on from checkpoints"
    );
    long[0].has_checkpoints = false;
    assert!(matches!(
        bundles(
            &long,
            &site,
            &taskfarm,
            InUse::default(),
            &Choices::default()
        ),
        Err(PlanError::DoesNotFit { .. })
    ));
}

prop_compose! {
    fn any_queue()(
        max_queued in proptest::option::of(1_u32..40),
        max_running in proptest::option::of(1_u32..20),
        max_nodes_per_job in 4_u32..40,
        max_nodes_per_user in proptest::option::of(40_u32..100),
        hours in 1_u64..30,
    ) -> Queue {
        Queue {
            max_queued,
            max_running,
            max_nodes_per_job: Some(max_nodes_per_job),
            max_nodes_per_user,
            walltime: crate::walltime::text(hours * 3600),
            ..queue(&site("archer2"), "taskfarm")
        }
    }
}

proptest! {
    #[test]
    fn every_simulation_is_in_exactly_one_job_and_no_limit_is_passed(
        queue in any_queue(),
        works in proptest::collection::vec((1_u32..=500, 1.0..2e5_f64), 0..150),
        queued in 0_u32..45,
        running in 0_u32..25,
        nodes in 0_u32..110,
    ) {
        let site = site("archer2");
        let all = works.iter().enumerate().map(|(i, (ranks, predicted_s))| Simulation {
            task: format!("t{i}"), ranks: ranks.div_ceil(100) * 100, predicted_s: *predicted_s, has_checkpoints: true,
        }).collect::<Vec<_>>();
        let in_use = InUse { queued, running, nodes, cores: 0 };
        let choices = Choices::default();
        let plan = bundles(&all, &site, &queue, in_use, &choices).expect("4 nodes hold 500 ranks");
        let mut seen = BTreeSet::new();
        for bundle in &plan {
            prop_assert_eq!(bundle.order().len(), bundle.lanes.iter().map(|lane| lane.tasks.len()).sum::<usize>());
            for task in bundle.order() {
                prop_assert!(seen.insert(task.to_owned()), "{} twice", task);
            }
            prop_assert!(bundle.n_nodes <= queue.max_nodes_per_job.unwrap_or(u32::MAX));
            prop_assert_eq!(bundle.n_nodes, bundle.lanes.len() as u32 * bundle.nodes_per_step);
            prop_assert!(bundle.nodes_per_step * site.node.cores >= bundle.ranks);
            prop_assert!(bundle.walltime_s <= queue.walltime_s());
            prop_assert!(bundle.walltime_s.is_multiple_of(60));
            for lane in &bundle.lanes {
                prop_assert!(lane.predicted_s <= longest_work_s(&queue, &choices) + 1e-6);
                prop_assert!(lane.predicted_s <= bundle.predicted_s());
            }
        }
        prop_assert_eq!(seen.len(), all.len());
        let now = plan.iter().filter(|bundle| bundle.now).count();
        prop_assert!(now <= queue.max_queued.unwrap_or(u32::MAX).saturating_sub(queued) as usize);
        let jobs = plan.iter().map(|bundle| (bundle.n_nodes, bundle.predicted_s())).collect::<Vec<_>>();
        let end = finish(&jobs, &queue, in_use);
        prop_assert!(end.most_at_once <= queue.max_running.unwrap_or(u32::MAX).saturating_sub(running).max(1));
        prop_assert!(jobs.iter().all(|(_, s)| *s <= end.after_s + 1e-6));
    }

    #[test]
    fn every_block_is_in_exactly_one_chunk_and_no_limit_is_passed(
        queue in any_queue(),
        n_blocks in 0_u64..5000,
        samples_per_block in 1_u64..40,
        s_per_sample in 0.001..20.0_f64,
        queued in 0_u32..45,
        arrays in any::<bool>(),
        max_size in 1_u32..50,
        by_core in any::<bool>(),
    ) {
        let mut site = site("archer2");
        site.arrays.allowed = arrays;
        site.arrays.max_size = max_size;
        if by_core {
            site.node.unit = crate::site::Unit::Core;
        }
        let in_use = InUse { queued, ..InUse::default() };
        let sweep = Sweep { n_blocks, samples_per_block, s_per_sample };
        let plan = chunks(&sweep, &site, &queue, in_use, &Choices::default()).expect("a block is minutes at most");
        let (mut next_chunk, largest) = (0, if arrays { max_size } else { 1 });
        for array in &plan.arrays {
            prop_assert_eq!(array.first, next_chunk);
            prop_assert!(array.n >= 1 && array.n <= largest);
            prop_assert!(array.at_once.is_none_or(|n| n >= 1 && n <= queue.max_running.unwrap_or(u32::MAX)));
            next_chunk += u64::from(array.n);
        }
        prop_assert_eq!(next_chunk, plan.n_chunks);
        let mut next_block = 0;
        for chunk in 0..plan.n_chunks {
            let blocks = plan.blocks(chunk);
            prop_assert_eq!(blocks.start, next_block);
            prop_assert!(!blocks.is_empty());
            next_block = blocks.end;
        }
        prop_assert_eq!(next_block, n_blocks);
        let now = plan.arrays.iter().filter(|array| array.now).map(|array| array.n).sum::<u32>();
        prop_assert!(now <= queue.max_queued.unwrap_or(u32::MAX).saturating_sub(queued));
        prop_assert!(plan.walltime_s <= queue.walltime_s());
        prop_assert!(plan.predicted_s <= longest_work_s(&queue, &Choices::default()) + 1e-6);
    }
}
