//! Check of the launcher and of the network: correctness and speed of the operations in a beat.

use std::str::FromStr;
use std::time::{Duration, Instant};

use cardiotwin_linalg::parallel::{Communicator, Layout, Neighbour};
use cardiotwin_protocol::process;
use serde::Serialize;

use super::failure::Failures;
use crate::team::gather_texts;

/// Number of nodes in each halo of the measurement.
const HALO_NODES: u32 = 500;
const REPETITIONS: u32 = 200;

/// A deliberate failure of one rank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fault {
    rank: usize,
    how: How,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum How {
    Panic,
    Error,
    Stall,
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once(':').and_then(|(rank, how)| {
            let how = match how {
                "panic" => How::Panic,
                "error" => How::Error,
                "stall" => How::Stall,
                _ => return None,
            };
            Some(Self {
                rank: rank.parse().ok()?,
                how,
            })
        });
        parsed.ok_or_else(|| {
            format!("`{text}`: expected RANK:panic, RANK:error or RANK:stall, such as 1:panic")
        })
    }
}

#[derive(Serialize)]
struct Found {
    ranks: usize,
    hosts: Vec<String>,
    reduction_us: f64,
    halo_us: f64,
    halo_bytes: u64,
}

/// Layout of a ring, in which each rank owns one halo for its predecessor and one for its
/// successor.
fn ring(rank: usize, n: usize) -> Layout {
    let mut neighbours = vec![];
    let mut others = vec![(rank + 1) % n, (rank + n - 1) % n];
    others.sort_unstable();
    others.dedup();
    let mut n_local = HALO_NODES;
    for other in others.into_iter().filter(|other| *other != rank) {
        neighbours.push(Neighbour {
            rank: other,
            send: (0..HALO_NODES).collect(),
            receive: (n_local..n_local + HALO_NODES).collect(),
        });
        n_local += HALO_NODES;
    }
    Layout {
        n_owned: HALO_NODES as usize,
        n_local: n_local as usize,
        neighbours,
    }
}

fn us_each(mut call: impl FnMut()) -> f64 {
    call();
    let begun = Instant::now();
    (0..REPETITIONS).for_each(|_| call());
    1e6 * begun.elapsed().as_secs_f64() / f64::from(REPETITIONS)
}

/// Exchanges values, checks them and measures the times. Collective.
pub fn check(comm: &dyn Communicator, fault: Option<Fault>, json: bool, failures: &Failures) {
    let (rank, n) = (comm.rank(), comm.n_ranks());
    let mut sums = [rank as f64, 1.0];
    comm.sum(&mut sums);
    let layout = ring(rank, n);
    let mut values = vec![rank as f64; 3 * layout.n_local];
    comm.update_ghosts(&layout, 3, &mut values);
    let right = sums == [(n * (n - 1) / 2) as f64, n as f64]
        && layout.neighbours.iter().all(|neighbour| {
            neighbour
                .receive
                .iter()
                .all(|node| values[3 * *node as usize + 2] == neighbour.rank as f64)
        });
    if !right {
        failures.end("values that were exchanged are not those that were sent");
    }
    if let Some(fault) = fault.filter(|fault| fault.rank == rank) {
        match fault.how {
            How::Panic => panic!("asked to panic"),
            How::Error => failures.end("asked to fail"),
            How::Stall => std::thread::sleep(Duration::MAX),
        }
    }
    let reduction_us = us_each(|| comm.sum(&mut [1.0, 2.0]));
    let halo_us = us_each(|| comm.update_ghosts(&layout, 3, &mut values));
    let Some(hosts) = gather_texts(comm, process::host()) else {
        return;
    };
    let halo_bytes = 24 * u64::from(HALO_NODES) * layout.neighbours.len() as u64;
    let found = Found {
        ranks: n,
        hosts,
        reduction_us,
        halo_us,
        halo_bytes,
    };
    if json {
        println!(
            "{}",
            serde_json::to_string(&found).expect("plain fields are JSON")
        );
    } else {
        let of_hosts: Vec<String> = (found
            .hosts
            .chunk_by(|a, b| a == b)
            .map(|h| format!("{} on {}", h.len(), h[0])))
        .collect();
        println!("{n} ranks: {}", of_hosts.join(", "));
        println!(
            "reduction of two numbers {reduction_us:.1} µs, halos of {halo_bytes} bytes {halo_us:.1} µs"
        );
    }
}
