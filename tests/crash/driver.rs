//! A coordinator in a process of its own for the crash tests. It drives patients of three no-op
//! tasks.
//!
//! `crash-driver RUN_DIR PATIENTS SLEEP_MS WORKERS (in-process | WORKER)` prints the summary as
//! JSON.

use std::path::PathBuf;
use std::process::ExitCode;

use cardiotwin_engine::{RunOptions, StopSignal, run};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [run_dir, patients, sleep_ms, workers, executor] = arguments.as_slice() else {
        eprintln!("usage: crash-driver RUN_DIR PATIENTS SLEEP_MS WORKERS (in-process | WORKER)");
        return ExitCode::from(2);
    };
    let number = |text: &String| text.parse::<u64>().expect("a number");
    let in_process = executor == "in-process";
    let sleep_ms = number(sleep_ms);
    let options = RunOptions {
        run_dir: PathBuf::from(run_dir),
        chosen: None,
        cohort_name: "crash".into(),
        description: String::new(),
        cohort_dir: PathBuf::from(run_dir),
        patients: Some(
            (1..=number(patients))
                .map(|n| ResolvedPatient::noop(&format!("P{n:03}"), sleep_ms))
                .collect(),
        ),
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        executor: ExecutorSettings {
            kind: if in_process {
                ExecutorKind::InProcess
            } else {
                ExecutorKind::Local
            },
            workers: u32::try_from(number(workers)).expect("a number of workers"),
            ..ExecutorSettings::default()
        },
        worker: (!in_process).then(|| PathBuf::from(executor)),
        adopt_version: true,
        watch: false,
    };
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .expect("a runtime");
    let summary = runtime.block_on(async {
        let stop = StopSignal::from_signals().expect("signal handlers");
        let (events, mut told) = tokio::sync::mpsc::unbounded_channel();
        let teller = tokio::spawn(async move {
            while let Some(event) = told.recv().await {
                eprintln!("{event:?}");
            }
        });
        let summary = run(options, events, stop).await;
        let _ = teller.await;
        summary
    });
    match summary {
        Ok(s) => {
            println!(
                r#"{{"done":{},"failed":{},"unfinished":{},"submitted":{},"published":{},"stopped":{}}}"#,
                s.done, s.failed, s.unfinished, s.submitted, s.published, s.stopped
            );
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
