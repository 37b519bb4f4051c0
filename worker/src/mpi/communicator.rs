//! Communicator over MPI ranks.
//!
//! No call blocks inside MPI. A waiting rank polls and leaves its core to others between polls. It
//! ends all ranks when another rank keeps it waiting for longer than the patience.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use cardiotwin_linalg::parallel::{Communicator, Layout, NodalValues};
use mpi::Tag;
use mpi::point_to_point::Message;
use mpi::request::{Request, Scope, scope};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, Destination as _, Source as _};

use super::failure::Failures;

const HALO: Tag = 1;
const REDUCTION: Tag = 2;
const GATHER: Tag = 3;
const SCATTER: Tag = 4;
const BROADCAST: Tag = 5;
/// Larger than any kind of message.
const KINDS: Tag = 8;
/// Largest number of ranks when processes hold several. Beyond it, the tags for each pair of ranks
/// and kind of message would exceed the smallest range that MPI guarantees.
pub const MOST_SHARING: usize = 63;

/// Time for which a waiting rank polls without pause if each rank has a core of its own. After it,
/// the rank sleeps between polls.
const SPIN: Duration = Duration::from_micros(100);
const SHORT_NAP: Duration = Duration::from_micros(20);
/// Time after which a rank that waits for an order polls at long intervals only.
const WAKEFUL: Duration = Duration::from_millis(200);
const NAP: Duration = Duration::from_millis(2);

/// A rank. Each process of `MPI_COMM_WORLD` holds the same number of ranks: one, or several on
/// separate threads.
#[derive(Debug)]
pub struct MpiRank {
    rank: usize,
    n_ranks: usize,
    per_process: usize,
    spin: Duration,
    patience: Duration,
    failures: Arc<Failures>,
    /// Buffers of messages to and from the neighbours, reused for every halo.
    letters: Mutex<[Vec<Vec<f64>>; 2]>,
}

/// Event that a rank waits for.
#[derive(Clone, Copy)]
enum Wait<'a> {
    For(&'a str, usize),
    Order,
}

fn world() -> SimpleCommunicator {
    SimpleCommunicator::world()
}

impl MpiRank {
    /// The `k`th of this process's `per_process` ranks. MPI must be initialised for that number of
    /// threads.
    pub fn new(
        (k, per_process): (usize, usize),
        has_own_core: bool,
        patience: Duration,
        failures: Arc<Failures>,
    ) -> Self {
        let (process, n_processes) = (world().rank() as usize, world().size() as usize);
        let (rank, n_ranks) = (process * per_process + k, n_processes * per_process);
        let spin = if has_own_core { SPIN } else { Duration::ZERO };
        Self {
            rank,
            n_ranks,
            per_process,
            spin,
            patience,
            failures,
            letters: Mutex::default(),
        }
    }

    fn process(&self, rank: usize) -> i32 {
        (rank / self.per_process) as i32
    }

    /// Tag of a message. Tags distinguish the ranks that share a process.
    fn tag(&self, kind: Tag, from: usize, to: usize) -> Tag {
        if self.per_process == 1 {
            kind
        } else {
            (from * self.n_ranks + to) as Tag * KINDS + kind
        }
    }

    /// Polls until `look` returns a value.
    fn until<T>(&self, wait: Wait<'_>, mut look: impl FnMut() -> Option<T>) -> T {
        let begun = Instant::now();
        loop {
            if let Some(found) = look() {
                return found;
            }
            let waited = begun.elapsed();
            match wait {
                _ if waited < self.spin => std::hint::spin_loop(),
                Wait::For(what, rank) if waited > self.patience => {
                    let seconds = self.patience.as_secs_f64();
                    self.failures.end(&format!(
                        "no progress: waited {seconds} s for {what} of rank {rank}"
                    ));
                }
                Wait::Order if waited > WAKEFUL => thread::sleep(NAP),
                // The rank that this one waits for may need the same core.
                _ => thread::sleep(SHORT_NAP),
            }
        }
    }

    fn done<'a, D: ?Sized, S: Scope<'a>>(&self, wait: Wait<'_>, request: Request<'a, D, S>) {
        let mut pending = Some(request);
        self.until(wait, || match pending.take()?.test() {
            Ok(_) => Some(()),
            Err(request) => {
                pending = Some(request);
                None
            }
        });
    }

    /// Values of all ranks, one after the other, on every rank, in ⌈log₂ n⌉ exchanges (Bruck et al.
    /// 1997, IEEE Trans Parallel Distrib Syst 8:1143).
    fn of_all(&self, own: &[f64]) -> Vec<f64> {
        let (n, width) = (self.n_ranks, own.len());
        let mut blocks = vec![0.0; n * width];
        blocks[..width].copy_from_slice(own);
        // Block k belongs to rank `self.rank + k`, modulo the number of ranks.
        let mut held = 1;
        while held < n {
            let more = held.min(n - held);
            let (to, from) = ((self.rank + n - held) % n, (self.rank + held) % n);
            let (here, rest) = blocks.split_at_mut(held * width);
            let (send, receive) = (&here[..more * width], &mut rest[..more * width]);
            scope(|scope| {
                let (here, there) = (
                    self.tag(REDUCTION, from, self.rank),
                    self.tag(REDUCTION, self.rank, to),
                );
                let (source, target) = (self.process(from), self.process(to));
                let receive = world()
                    .process_at_rank(source)
                    .immediate_receive_into_with_tag(scope, receive, here);
                let send = world()
                    .process_at_rank(target)
                    .immediate_send_with_tag(scope, send, there);
                self.done(Wait::For("a reduction", from), receive);
                self.done(Wait::For("a reduction", to), send);
            });
            held += more;
        }
        blocks.rotate_right(self.rank * width);
        blocks
    }

    /// Reduces in the order of ranks, as threads do, so that results agree with theirs bit for bit.
    fn reduce(&self, values: &mut [f64], add: impl Fn(f64, f64) -> f64) {
        if self.n_ranks == 1 || values.is_empty() {
            return;
        }
        let width = values.len();
        let all = self.of_all(values);
        values.copy_from_slice(&all[..width]);
        for of_rank in all.chunks_exact(width).skip(1) {
            values
                .iter_mut()
                .zip(of_rank)
                .for_each(|(value, other)| *value = add(*value, *other));
        }
    }

    /// Broadcasts from rank 0 along a binomial tree.
    fn take_from_rank_0(&self, wait: Wait<'_>, values: &mut [f64]) {
        if self.n_ranks == 1 || values.is_empty() {
            return;
        }
        let mut reach = 1;
        while reach < self.n_ranks {
            let next = 2 * reach;
            if (reach..next).contains(&self.rank) {
                let from = self.rank - reach;
                let tag = self.tag(BROADCAST, from, self.rank);
                let source = self.process(from);
                scope(|scope| {
                    let request = world()
                        .process_at_rank(source)
                        .immediate_receive_into_with_tag(scope, &mut *values, tag);
                    self.done(wait, request);
                });
            } else if self.rank < reach && self.rank + reach < self.n_ranks {
                self.send(self.rank + reach, BROADCAST, values);
            }
            reach = next;
        }
    }

    fn send(&self, to: usize, tag: Tag, values: &[f64]) {
        scope(|scope| {
            let (target, tag) = (self.process(to), self.tag(tag, self.rank, to));
            let request = world()
                .process_at_rank(target)
                .immediate_send_with_tag(scope, values, tag);
            self.done(Wait::For("a receipt", to), request);
        });
    }

    /// Receives a message of unknown length.
    fn receive(&self, from: usize, tag: Tag) -> Vec<f64> {
        let source = world();
        let source = source.process_at_rank(self.process(from));
        let tag = self.tag(tag, from, self.rank);
        let (message, status): (Message, _) = self.until(Wait::For("a message", from), || {
            source.immediate_matched_probe_with_tag(tag)
        });
        let n = status.count(<f64 as mpi::datatype::Equivalence>::equivalent_datatype());
        let mut values = vec![0.0; n as usize];
        scope(|scope| {
            let request = message.immediate_matched_receive_into(scope, &mut values[..]);
            self.done(Wait::For("a message", from), request);
        });
        values
    }
}

impl Communicator for MpiRank {
    fn rank(&self) -> usize {
        self.rank
    }

    fn n_ranks(&self) -> usize {
        self.n_ranks
    }

    fn sum(&self, values: &mut [f64]) {
        self.reduce(values, |a, b| a + b);
    }

    fn max(&self, values: &mut [f64]) {
        self.reduce(values, |a, b| {
            if a.is_nan() || b.is_nan() {
                f64::NAN
            } else {
                a.max(b)
            }
        });
    }

    fn broadcast(&self, values: &mut [f64]) {
        self.take_from_rank_0(Wait::For("news", 0), values);
    }

    fn command(&self, values: &mut [f64]) {
        self.take_from_rank_0(Wait::For("a command", 0), values);
    }

    fn order(&self, values: &mut [f64]) {
        self.take_from_rank_0(Wait::Order, values);
    }

    fn exchange(&self, layout: &Layout, width: usize, mut values: NodalValues<'_>) {
        let mut letters = self.letters.lock().unwrap_or_else(PoisonError::into_inner);
        let [out, into] = &mut *letters;
        for letters in [&mut *out, &mut *into] {
            letters.resize(layout.neighbours.len().max(letters.len()), vec![]);
        }
        for ((neighbour, out), into) in layout.neighbours.iter().zip(&mut *out).zip(&mut *into) {
            out.clear();
            values.read(&neighbour.send, width, out);
            into.resize(neighbour.receive.len() * width, 0.0);
        }
        scope(|scope| {
            let mut requests = vec![];
            for (neighbour, into) in layout.neighbours.iter().zip(&mut *into) {
                let other = world();
                let other = other.process_at_rank(self.process(neighbour.rank));
                let tag = self.tag(HALO, neighbour.rank, self.rank);
                requests.push((
                    neighbour.rank,
                    other.immediate_receive_into_with_tag(scope, &mut into[..], tag),
                ));
            }
            let mut sends = vec![];
            for (neighbour, out) in layout.neighbours.iter().zip(&*out) {
                let other = world();
                let other = other.process_at_rank(self.process(neighbour.rank));
                let tag = self.tag(HALO, self.rank, neighbour.rank);
                sends.push((
                    neighbour.rank,
                    other.immediate_send_with_tag(scope, &out[..], tag),
                ));
            }
            requests
                .into_iter()
                .for_each(|(rank, request)| self.done(Wait::For("a halo", rank), request));
            sends
                .into_iter()
                .for_each(|(rank, request)| self.done(Wait::For("a halo", rank), request));
        });
        for (neighbour, into) in layout.neighbours.iter().zip(&*into) {
            values.write(&neighbour.receive, width, into);
        }
    }

    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>> {
        if self.rank > 0 {
            self.send(0, GATHER, values);
            return None;
        }
        let others = (1..self.n_ranks).map(|rank| self.receive(rank, GATHER));
        Some(std::iter::once(values.to_vec()).chain(others).collect())
    }

    fn scatter(&self, mut parts: Vec<Vec<f64>>) -> Vec<f64> {
        if self.rank > 0 {
            return self.receive(0, SCATTER);
        }
        for (rank, part) in parts.iter().enumerate().skip(1) {
            self.send(rank, SCATTER, part);
        }
        parts.swap_remove(0)
    }
}
