//! Memory bandwidth of a number of threads, measured with McCalpin's triad `a = b + s·c` on arrays
//! larger than any cache.

use std::hint::black_box;
use std::sync::Barrier;
use std::time::Instant;

/// Length of each array, over all threads: 128 MB.
const N: usize = 1 << 24;
/// Number of passes; the fastest one counts.
const PASSES: usize = 8;

/// Bandwidth in GB/s, counting 24 bytes per element. The lines of `a` that caches fetch before
/// overwriting them are not counted.
#[must_use]
pub fn triad_gb_per_s(threads: usize) -> f64 {
    let barrier = Barrier::new(threads);
    let n = N / threads.max(1);
    let on_thread = || {
        let (mut a, b, c) = (vec![0.0; n], vec![1.0; n], vec![2.0; n]);
        let mut best = f64::INFINITY;
        for pass in 0..PASSES {
            barrier.wait();
            let begun = Instant::now();
            let s = black_box(pass as f64);
            for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
                *a = b + s * c;
            }
            black_box(&mut a);
            barrier.wait();
            best = best.min(begun.elapsed().as_secs_f64());
        }
        best
    };
    let seconds = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(on_thread)).collect();
        let own = on_thread();
        others
            .into_iter()
            .filter_map(|other| other.join().ok())
            .fold(own, f64::max)
    });
    1e-9 * 24.0 * (n * threads.max(1)) as f64 / seconds
}

#[cfg(test)]
mod tests {
    #[test]
    fn memory_gives_something() {
        assert!(super::triad_gb_per_s(2) > 0.1);
    }
}
