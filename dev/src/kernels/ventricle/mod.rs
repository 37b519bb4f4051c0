//! Times one beat of a generated 3D ventricle and the kernels that it consists of.

mod figures;
mod measure;
mod shortcuts;
mod subject;

use cardiotwin_mechanics::organ::FiniteElementVentricle;
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_units::Ms;
use cardiotwin_worker::process::cpu_s;
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::team::Team;

use figures::failed;
pub use figures::{
    BenchError, Element, NsPerTet, OfRank, Ranks, SecondsPerPhase, VentricleBench, VentricleTiming,
};
pub use shortcuts::{Shortcut, Shortcuts, shortcuts};
use subject::Subject;

/// Runs the beat for each of `counts` (threads, or a team of processes) and measures it. `report`
/// receives the name of each stage and the progress of the beat.
///
/// # Errors
/// [`BenchError`] when the mesh cannot be made, when the ventricle has no end-diastole, or when
/// `stop` is raised.
pub fn ventricle(
    bench: &VentricleBench,
    counts: &[Ranks<'_>],
    stop: &StopFlag,
    mut report: impl FnMut(&str),
) -> Result<Vec<VentricleTiming>, BenchError> {
    let subject = Subject::new(bench.nodes, bench.element, counts, stop, &mut report)?;
    let mut found = vec![];
    for ranks in counts {
        let before_mb = measure::anew();
        let before_mb = if found.is_empty() { before_mb } else { 0.0 };
        found.push(measure::measure(
            &subject,
            bench,
            (*ranks, before_mb),
            stop,
            &mut report,
        )?);
    }
    Ok(found)
}

/// Helps rank 0 of `team`, which calls [`ventricle`] with the same `bench`.
///
/// # Errors
/// [`BenchError`] of this rank.
pub fn follow(bench: &VentricleBench, team: &Team) -> Result<(), BenchError> {
    team.follow().map_err(failed("no inflation"))?;
    let (before_mb, cpu) = (measure::anew(), cpu_s());
    let settings = StepSettings {
        relative_tolerance: bench.tolerance,
        ..StepSettings::default()
    };
    let wall = subject::wall();
    let parts = subject::of_another_rank(&wall, Ms(bench.cycle_ms), settings)?;
    FiniteElementVentricle::serve(parts, team.comm()).map_err(failed("no ventricle"))?;
    measure::costs(Ranks::Team(team), before_mb, cpu_s() - cpu);
    Ok(())
}

/// Formats the timings of one or several numbers of ranks. The text compares the last beat with the
/// first. As JSON, one beat is an object; several are a list `beats` with `speedup`, the first
/// beat's time divided by that of each beat.
///
/// # Errors
/// None in practice: the figures are valid JSON.
pub fn text_of(timings: &[VentricleTiming], json: bool) -> serde_json::Result<String> {
    let first = timings
        .first()
        .map_or(f64::NAN, |timing| timing.seconds_total);
    let speedup: Vec<f64> = timings
        .iter()
        .map(|timing| first / timing.seconds_total)
        .collect();
    if json {
        let text = match timings {
            [one] => serde_json::to_string(one)?,
            several => {
                serde_json::to_string(&serde_json::json!({ "beats": several, "speedup": speedup }))?
            }
        };
        return Ok(text + "\n");
    }
    let mut text = String::new();
    for (timing, speedup) in timings.iter().zip(&speedup) {
        text += &format!("{timing}\n");
        if timings.len() > 1 {
            text += &format!(
                "{} ranks against {}: {speedup:.2} times as fast\n\n",
                timing.threads, timings[0].threads
            );
        }
    }
    Ok(text)
}
