//! Ranks as threads of one process.
//!
//! In a reduction, each rank posts its values on its own desk, which all others read. Two sets of
//! values alternate, so that a rank that is ahead does not overwrite values that another rank still
//! reads. Halos pass through a letterbox for each pair of ranks. A waiting rank spins for some
//! microseconds, then yields its core between polls, then sleeps. On a busy machine, other threads
//! need the core; on an idle one, waking up takes longer than most waits. Where ranks outnumber the
//! cores, nothing spins.
//!
//! No rank waits for ever. When a rank fails, leaves early, or keeps another one waiting for longer
//! than [`ThreadSettings::patience`], all ranks end with the same [`RankFailure`].

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

// A length of time, not a clock.
use core::time::Duration;

use super::{Communicator, Layout, NodalValues};

/// Number of values in a post; longer lists take several posts.
const POST: usize = 16;
/// Number of polls before a waiting rank begins to yield its core.
const SPINS: usize = 500;
/// Number of polls with yields before a waiting rank sleeps.
const YIELDS: usize = 500;

/// Settings of a group of threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ThreadSettings {
    /// Time after which a rank that waits for another one ends the group.
    pub patience: Duration,
}

impl Default for ThreadSettings {
    fn default() -> Self {
        Self {
            patience: Duration::from_secs(600),
        }
    }
}

/// Reason why a group ended, from the first rank that failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("rank {rank} of {n_ranks}: {reason}")]
pub struct RankFailure {
    /// Number of the failed rank, from zero.
    pub rank: usize,
    /// Number of ranks in the group.
    pub n_ranks: usize,
    /// Message of the rank that failed.
    pub reason: String,
}

/// Payload with which ranks unwind that did not fail themselves.
struct Ended;

/// Place where a rank posts its contributions to reductions.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Desk {
    /// Number of posts so far; only the desk's rank writes it.
    posts: AtomicU64,
    values: [[AtomicU64; POST]; 2],
    left: AtomicBool,
}

/// Buffers for messages from one rank to another.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Letterbox {
    sent: AtomicU64,
    taken: AtomicU64,
    letters: [Mutex<Vec<f64>>; 2],
}

/// Place where ranks sleep until a certain rank acts.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Bed {
    sleepers: AtomicUsize,
    door: Mutex<()>,
    bell: Condvar,
}

impl Bed {
    /// Wakes the sleepers after a change.
    fn ring(&self) {
        // Sequentially consistent, like the change itself: a sleeper that this load misses will see
        // the change.
        if self.sleepers.load(Ordering::SeqCst) > 0 {
            drop(locked(&self.door));
            self.bell.notify_all();
        }
    }
}

#[derive(Debug)]
struct Group {
    desks: Vec<Desk>,
    /// The letterbox from `a` to `b` is at `a · n + b`.
    letterboxes: Vec<Letterbox>,
    ended: AtomicBool,
    failure: Mutex<Option<RankFailure>>,
    /// At `a` sleep those who wait for rank `a`, so that an action does not wake the whole group.
    beds: Vec<Bed>,
    patience: Duration,
    /// Whether there are more ranks than cores, so that a spinning rank takes the time of the one that
    /// it waits for.
    crowded: bool,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Values that an unwinding rank leaves behind are never read.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Group {
    fn new(n_ranks: usize, settings: ThreadSettings) -> Self {
        Self {
            desks: (0..n_ranks).map(|_| Desk::default()).collect(),
            letterboxes: (0..n_ranks * n_ranks)
                .map(|_| Letterbox::default())
                .collect(),
            ended: AtomicBool::new(false),
            failure: Mutex::new(None),
            beds: (0..n_ranks).map(|_| Bed::default()).collect(),
            patience: settings.patience,
            crowded: std::thread::available_parallelism().is_ok_and(|cores| n_ranks > cores.get()),
        }
    }

    fn end(&self) {
        self.ended.store(true, Ordering::SeqCst);
        for bed in &self.beds {
            bed.ring();
        }
    }

    /// Ends the group; only the first failure is kept.
    fn fail(&self, rank: usize, reason: String) {
        let n_ranks = self.desks.len();
        if !self.ended.load(Ordering::SeqCst) {
            locked(&self.failure).get_or_insert(RankFailure {
                rank,
                n_ranks,
                reason,
            });
        }
        self.end();
    }

    fn leave(&self, rank: usize) {
        self.desks[rank].left.store(true, Ordering::SeqCst);
        self.beds[rank].ring();
    }

    /// Runs `work` and ends the group if it panics.
    fn guard<T>(&self, rank: usize, work: impl FnOnce() -> T) -> Option<T> {
        let done = catch_unwind(AssertUnwindSafe(work));
        let out = match done {
            Ok(out) => Some(out),
            Err(payload) => {
                if !payload.is::<Ended>() {
                    self.fail(rank, text(payload.as_ref()));
                }
                None
            }
        };
        self.leave(rank);
        out
    }
}

fn text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|t| (*t).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "panicked without a word".to_owned())
}

/// Reason why a rank no longer sleeps.
enum Waking {
    /// Its wait is over.
    Done,
    /// The group has ended.
    Ended,
    /// Its wait can have no end, with the reason.
    InVain(String),
}

/// A rank of a group of threads.
#[derive(Debug, Clone)]
pub struct ThreadRank {
    rank: usize,
    group: Arc<Group>,
}

impl ThreadRank {
    /// Waits until `done` is true, which requires an action of rank `other`.
    fn wait(&self, other: usize, patience: Option<Duration>, done: impl Fn() -> bool) {
        if done() {
            return;
        }
        let spins = if self.group.crowded { 0 } else { SPINS };
        for _ in 0..spins {
            std::hint::spin_loop();
            if done() {
                return;
            }
        }
        for _ in 0..YIELDS {
            std::thread::yield_now();
            if done() {
                return;
            }
        }
        match self.sleep(other, patience, done) {
            Waking::Done => return,
            Waking::Ended => {}
            Waking::InVain(reason) => self.group.fail(self.rank, reason),
        }
        self.unwind();
    }

    /// Sleeps until `done` is true, or until nothing can make it true.
    fn sleep(&self, other: usize, patience: Option<Duration>, done: impl Fn() -> bool) -> Waking {
        let group = &*self.group;
        let bed = &group.beds[other];
        let mut door = locked(&bed.door);
        bed.sleepers.fetch_add(1, Ordering::SeqCst);
        let why = loop {
            let left = group.desks[other].left.load(Ordering::SeqCst);
            if done() {
                break Waking::Done;
            }
            if group.ended.load(Ordering::SeqCst) {
                break Waking::Ended;
            }
            if left {
                break Waking::InVain(format!("rank {other} has left, and will not do its part"));
            }
            door = match patience {
                None => bed.bell.wait(door).unwrap_or_else(PoisonError::into_inner),
                Some(patience) => {
                    let (door, waited) = bed
                        .bell
                        .wait_timeout(door, patience)
                        .unwrap_or_else(PoisonError::into_inner);
                    if waited.timed_out() && !done() {
                        break Waking::InVain(format!(
                            "no progress: waited {} s for rank {other}",
                            patience.as_secs_f64()
                        ));
                    }
                    door
                }
            };
        };
        bed.sleepers.fetch_sub(1, Ordering::SeqCst);
        why
    }

    /// Leaves a group that has ended. It bypasses the panic hook, which has already run if the
    /// failure was a panic.
    fn unwind(&self) -> ! {
        match locked(&self.group.failure).clone() {
            // The caller of rank 0 gets the reason.
            Some(failure) if self.rank == 0 => resume_unwind(Box::new(failure.to_string())),
            _ => resume_unwind(Box::new(Ended)),
        }
    }

    /// Posts up to [`POST`] values and returns the number of the post.
    fn post(&self, values: &[f64]) -> u64 {
        let group = &*self.group;
        let desk = &group.desks[self.rank];
        let number = desk.posts.load(Ordering::Relaxed) + 1;
        // A rank that has made the previous post has read the one before it, whose place this post
        // takes.
        for (rank, other) in group.desks.iter().enumerate() {
            self.wait(rank, Some(group.patience), || {
                other.posts.load(Ordering::SeqCst) + 1 >= number
            });
        }
        for (place, value) in desk.values[(number & 1) as usize].iter().zip(values) {
            place.store(value.to_bits(), Ordering::Relaxed);
        }
        desk.posts.store(number, Ordering::SeqCst);
        group.beds[self.rank].ring();
        number
    }

    /// Waits for the post of another rank and returns its values.
    fn read(&self, other: usize, number: u64, patience: Option<Duration>) -> &[AtomicU64; POST] {
        let desk = &self.group.desks[other];
        self.wait(other, patience, || {
            desk.posts.load(Ordering::SeqCst) >= number
        });
        &desk.values[(number & 1) as usize]
    }

    fn reduce(&self, values: &mut [f64], add: impl Fn(f64, f64) -> f64) {
        for values in values.chunks_mut(POST) {
            let number = self.post(values);
            for rank in 0..self.n_ranks() {
                let posted = self.read(rank, number, Some(self.group.patience));
                for (value, posted) in values.iter_mut().zip(posted) {
                    let posted = f64::from_bits(posted.load(Ordering::Relaxed));
                    *value = if rank == 0 {
                        posted
                    } else {
                        add(*value, posted)
                    };
                }
            }
        }
    }

    fn broadcast_within(&self, values: &mut [f64], patience: Option<Duration>) {
        for values in values.chunks_mut(POST) {
            let number = self.post(values);
            if self.rank > 0 {
                for (value, posted) in values.iter_mut().zip(self.read(0, number, patience)) {
                    *value = f64::from_bits(posted.load(Ordering::Relaxed));
                }
            }
        }
    }

    fn send(&self, to: usize, write: impl FnOnce(&mut Vec<f64>)) {
        let letterbox = &self.group.letterboxes[self.rank * self.n_ranks() + to];
        let number = letterbox.sent.load(Ordering::Relaxed) + 1;
        self.wait(to, Some(self.group.patience), || {
            letterbox.taken.load(Ordering::SeqCst) + 2 >= number
        });
        let mut letter = locked(&letterbox.letters[(number & 1) as usize]);
        letter.clear();
        write(&mut letter);
        drop(letter);
        letterbox.sent.store(number, Ordering::SeqCst);
        self.group.beds[self.rank].ring();
    }

    fn receive<T>(&self, from: usize, read: impl FnOnce(&[f64]) -> T) -> T {
        let letterbox = &self.group.letterboxes[from * self.n_ranks() + self.rank];
        let number = letterbox.taken.load(Ordering::Relaxed) + 1;
        self.wait(from, Some(self.group.patience), || {
            letterbox.sent.load(Ordering::SeqCst) >= number
        });
        let out = read(&locked(&letterbox.letters[(number & 1) as usize]));
        letterbox.taken.store(number, Ordering::SeqCst);
        self.group.beds[self.rank].ring();
        out
    }
}

impl Communicator for ThreadRank {
    fn rank(&self) -> usize {
        self.rank
    }

    fn n_ranks(&self) -> usize {
        self.group.desks.len()
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
        self.broadcast_within(values, Some(self.group.patience));
    }

    fn command(&self, values: &mut [f64]) {
        self.broadcast_within(values, None);
    }

    fn exchange(&self, layout: &Layout, width: usize, mut values: NodalValues<'_>) {
        for neighbour in &layout.neighbours {
            self.send(neighbour.rank, |letter| {
                values.read(&neighbour.send, width, letter);
            });
        }
        for neighbour in &layout.neighbours {
            self.receive(neighbour.rank, |letter| {
                values.write(&neighbour.receive, width, letter);
            });
        }
    }

    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>> {
        if self.rank > 0 {
            self.send(0, |letter| letter.extend_from_slice(values));
            return None;
        }
        let others = (1..self.n_ranks()).map(|rank| self.receive(rank, <[f64]>::to_vec));
        Some(std::iter::once(values.to_vec()).chain(others).collect())
    }

    fn scatter(&self, mut parts: Vec<Vec<f64>>) -> Vec<f64> {
        if self.rank > 0 {
            return self.receive(0, <[f64]>::to_vec);
        }
        for (rank, part) in parts.iter_mut().enumerate().skip(1) {
            self.send(rank, |letter| std::mem::swap(letter, part));
        }
        parts.swap_remove(0)
    }
}

/// Threads of the ranks from 1 on; rank 0 uses the caller's thread.
#[derive(Debug)]
pub struct Crew {
    group: Arc<Group>,
    threads: Vec<JoinHandle<()>>,
}

/// Starts a thread for each rank from 1 on, which runs the `work` for this rank. Returns rank 0 for
/// the calling thread, and the crew of threads. Dropping the crew ends the group, so that waiting
/// ranks unwind.
///
/// # Errors
/// If the system cannot start a thread.
pub fn crew<W: FnOnce(ThreadRank) + Send + 'static>(
    n_ranks: usize,
    settings: ThreadSettings,
    mut work: impl FnMut(usize) -> W,
) -> std::io::Result<(ThreadRank, Crew)> {
    let group = Arc::new(Group::new(n_ranks.max(1), settings));
    let first = ThreadRank {
        rank: 0,
        group: group.clone(),
    };
    let mut crew = Crew {
        group: group.clone(),
        threads: vec![],
    };
    for rank in 1..n_ranks {
        let (work, comm) = (
            work(rank),
            ThreadRank {
                rank,
                group: group.clone(),
            },
        );
        let thread = std::thread::Builder::new().name(format!("rank {rank}"));
        crew.threads.push(thread.spawn(move || {
            let group = comm.group.clone();
            group.guard(rank, || work(comm));
        })?);
    }
    Ok((first, crew))
}

impl Crew {
    /// Failure that ended the group, if a rank failed.
    #[must_use]
    pub fn failure(&self) -> Option<RankFailure> {
        locked(&self.group.failure).clone()
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        let group = &*self.group;
        group.end();
        for (desk, bed) in group
            .desks
            .iter()
            .zip(&group.beds)
            .skip(1)
            .take(self.threads.len())
        {
            let door = locked(&bed.door);
            bed.sleepers.fetch_add(1, Ordering::SeqCst);
            let (door, waited) = bed
                .bell
                .wait_timeout_while(door, group.patience, |()| !desk.left.load(Ordering::SeqCst))
                .unwrap_or_else(PoisonError::into_inner);
            bed.sleepers.fetch_sub(1, Ordering::SeqCst);
            drop(door);
            if waited.timed_out() {
                // If a rank never stops computing, a leaked thread is better than a program that
                // hangs.
                return;
            }
        }
        for thread in self.threads.drain(..) {
            // The thread has caught its own panic.
            let _ = thread.join();
        }
    }
}

/// Runs `work` on every rank of a group, one of them on the calling thread. Returns the results in
/// the order of ranks.
///
/// # Errors
/// [`RankFailure`] of the first rank that panicked or waited too long.
pub fn on_threads<T: Send>(
    n_ranks: usize,
    settings: ThreadSettings,
    work: impl Fn(ThreadRank) -> T + Sync,
) -> Result<Vec<T>, RankFailure> {
    let group = Arc::new(Group::new(n_ranks.max(1), settings));
    let on_rank = |rank: usize| {
        group.guard(rank, || {
            work(ThreadRank {
                rank,
                group: group.clone(),
            })
        })
    };
    let done: Vec<Option<T>> = std::thread::scope(|scope| {
        let others: Vec<_> = (1..n_ranks)
            .map(|rank| scope.spawn(move || on_rank(rank)))
            .collect();
        let first = on_rank(0);
        std::iter::once(first)
            .chain(others.into_iter().map(|other| other.join().unwrap_or(None)))
            .collect()
    });
    match locked(&group.failure).take() {
        Some(failure) => Err(failure),
        None => Ok(done.into_iter().flatten().collect()),
    }
}

#[cfg(test)]
mod tests;
