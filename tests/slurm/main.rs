//! The coordinator on a real Slurm on this machine: cohorts, every class of failure, faults of the
//! scheduler itself.
//!
//! A test harness of its own: one Slurm is started for all tests and stopped by its process ids at
//! the end, unless `SLURM_CONF` points to one whose folder was made by
//! `deploy/one-machine-slurm.sh`. Without a Slurm the tests are skipped with a message.

#[path = "../built.rs"]
mod built;
mod bundles;
mod cluster;
mod cohort;
mod endings;
mod failures;
mod faults;
mod figures;
mod kills;
mod privacy;
mod ranks;
mod sites;
mod sweeps;
mod whole;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use cluster::Cluster;

/// Number of tests that could not be run here.
static N_NOT_TESTED: AtomicUsize = AtomicUsize::new(0);

/// Tells why a test cannot be run here, and counts it.
fn not_tested(needs: &str, why: &str) {
    N_NOT_TESTED.fetch_add(1, Ordering::Relaxed);
    cardiotwin_not_tested::not_tested(needs, why);
}

/// Name and function of a test.
type Test = (&'static str, fn(&Cluster));

const TESTS: &[Test] = &[
    (
        "a cohort is done after one wait in the queue",
        whole::a_cohort_is_done_after_one_wait_in_the_queue,
    ),
    (
        "nothing but the pseudonym is seen",
        privacy::nothing_but_the_pseudonym_is_seen,
    ),
    (
        "a tick takes two commands",
        whole::a_tick_takes_two_commands,
    ),
    (
        "a cohort on another solver survives a killed worker",
        whole::a_cohort_on_another_solver_survives_a_killed_worker,
    ),
    (
        "four patients share two nodes of ARCHER2",
        ranks::four_patients_share_two_nodes_of_archer2,
    ),
    (
        "shipped profiles run on Slurms with the sites' partitions",
        sites::shipped_profiles_run_on_slurms_with_the_sites_partitions,
    ),
    (
        "a launcher of another MPI is told",
        ranks::a_launcher_of_another_mpi_is_told,
    ),
    (
        "a faulty srun is tried again",
        ranks::a_faulty_srun_is_tried_again,
    ),
    (
        "one simulation spans nodes",
        ranks::one_simulation_spans_nodes,
    ),
    (
        "a simulation over nodes loses one and is cancelled",
        ranks::a_simulation_over_nodes_loses_one_and_is_cancelled,
    ),
    (
        "ranks that run out of memory get more",
        ranks::ranks_that_run_out_of_memory_get_more,
    ),
    (
        "a plan is what is submitted",
        whole::a_plan_is_what_is_submitted,
    ),
    (
        "a job that submits itself brings a cohort to its end",
        whole::a_job_that_submits_itself_brings_a_cohort_to_its_end,
    ),
    (
        "a run on a shared file system is read from a snapshot",
        whole::a_run_on_a_shared_file_system_is_read_from_a_snapshot,
    ),
    ("no accounting is needed", faults::no_accounting_is_needed),
    (
        "a frozen controller has the job all the same",
        faults::a_frozen_controller_has_the_job_all_the_same,
    ),
    (
        "of two ticks at once one works",
        faults::of_two_ticks_at_once_one_works,
    ),
    (
        "a killed coordinator is continued",
        faults::a_killed_coordinator_is_continued,
    ),
    (
        "a job that a person cancels stays cancelled",
        failures::a_job_that_a_person_cancels_stays_cancelled,
    ),
    (
        "cancel ends the job and waits for it",
        failures::cancel_ends_the_job_and_waits_for_it,
    ),
    ("a lost node is avoided", failures::a_lost_node_is_avoided),
    (
        "a warning leaves a checkpoint and another job goes on",
        failures::a_warning_leaves_a_checkpoint_and_another_job_goes_on,
    ),
    (
        "out of memory asks for more",
        failures::out_of_memory_asks_for_more,
    ),
    (
        "a killed worker is tried again",
        failures::a_killed_worker_is_tried_again,
    ),
    (
        "a full queue is waited for",
        failures::a_full_queue_is_waited_for,
    ),
    (
        "a full queue gives way to the next",
        failures::a_full_queue_gives_way_to_the_next,
    ),
    (
        "a run begins after another job",
        failures::a_run_begins_after_another_job,
    ),
    (
        "what Slurm never takes is told",
        failures::what_slurm_never_takes_is_told,
    ),
    (
        "variables of the caller change no job",
        failures::variables_of_the_caller_change_no_job,
    ),
    (
        "a preempted job is submitted again",
        failures::a_preempted_job_is_submitted_again,
    ),
    (
        "a divergence is the science's and no job is repeated",
        failures::a_divergence_is_the_sciences_and_no_job_is_repeated,
    ),
    (
        "a simulation in 3D that ends early is gone on from",
        failures::a_simulation_in_3d_that_ends_early_is_gone_on_from,
    ),
    (
        "bad input is never tried again",
        failures::bad_input_is_never_tried_again,
    ),
    (
        "a worker that aborts is a defect and stops",
        failures::a_worker_that_aborts_is_a_defect_and_stops,
    ),
    ("a whole node is filled", failures::a_whole_node_is_filled),
    (
        "walltimes and a killed slurmd",
        endings::walltimes_and_a_killed_slurmd,
    ),
    (
        "a killed chunk goes on at its first missing sample",
        sweeps::a_killed_chunk_goes_on_at_its_first_missing_sample,
    ),
    (
        "a robustness sweep in 3D is packed into an array",
        sweeps::a_robustness_sweep_in_3d_is_packed_into_an_array,
    ),
    (
        "arrays are split where Slurm says",
        sweeps::arrays_are_split_where_slurm_says,
    ),
];

/// Tests that run only with `--ignored` (`make slurm-kills`): they take minutes, and print figures
/// for the documentation.
const LONG: &[Test] = &[
    (
        "several whole nodes in one job",
        bundles::several_whole_nodes_in_one_job,
    ),
    (
        "ranks of MPICH start through PMI-2",
        ranks::ranks_of_mpich_start_through_pmi2,
    ),
    (
        "the paper's run is rehearsed",
        ranks::the_papers_run_is_rehearsed,
    ),
    (
        "a cohort in 3D survives kills",
        kills::a_cohort_in_3d_survives_kills,
    ),
    (
        "seven patients in 3D survive kills",
        kills::seven_patients_in_3d_survive_kills,
    ),
    ("a hundred random kills", kills::a_hundred_random_kills),
    (
        "a sensitivity analysis on four nodes",
        figures::a_sensitivity_analysis_on_four_nodes,
    ),
];

fn main() -> ExitCode {
    let tests = if std::env::args().any(|a| a == "--ignored") {
        LONG
    } else {
        TESTS
    };
    let wanted: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    if std::env::args().any(|a| a == "--list") {
        tests.iter().for_each(|(name, _)| println!("{name}: test"));
        return ExitCode::SUCCESS;
    }
    let cluster = match Cluster::get() {
        Ok(cluster) => cluster,
        Err(why) => {
            cardiotwin_not_tested::not_tested("slurm", why);
            println!("test result: ok. 0 passed; {} without a Slurm", tests.len());
            return ExitCode::SUCCESS;
        }
    };
    let (mut passed, mut failed) = (0, Vec::new());
    for (name, test) in tests
        .iter()
        .filter(|(name, _)| wanted.is_empty() || wanted.iter().any(|w| name.contains(w.as_str())))
    {
        let began = Instant::now();
        cluster.recover();
        let ok = catch_unwind(AssertUnwindSafe(|| test(&cluster))).is_ok();
        println!(
            "test {name} ... {} ({:.1} s)",
            if ok { "ok" } else { "FAILED" },
            began.elapsed().as_secs_f64()
        );
        if ok { passed += 1 } else { failed.push(*name) }
    }
    drop(cluster);
    let n_not_tested = N_NOT_TESTED.load(Ordering::Relaxed);
    println!(
        "test result: {}. {} passed; {} failed; {n_not_tested} not tested",
        if failed.is_empty() { "ok" } else { "FAILED" },
        passed - n_not_tested,
        failed.len()
    );
    failed.iter().for_each(|name| println!("failed: {name}"));
    if failed.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
