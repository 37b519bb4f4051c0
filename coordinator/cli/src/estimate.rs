//! Expected end of a local run, from the pace of its finished patients.

use cardiotwin_dashboard::Estimate;
use cardiotwin_engine::Pace;

use crate::talk::count;

/// Least remaining time of a patient, as a share of the mean: one that took longer than the mean is
/// not done for that.
const LEAST: f64 = 0.1;

/// Mean time of the finished patients, ms.
fn mean_ms(pace: &Pace) -> f64 {
    pace.done_ms.iter().sum::<i64>() as f64 / pace.done_ms.len() as f64
}

/// Time left, ms, if each open patient takes as long as the finished ones did on average, and as
/// many attempts as now are at work. `None` if nothing is left, nothing is at work, or nobody is
/// done.
#[must_use]
pub fn left_ms(pace: &Pace) -> Option<f64> {
    if pace.open_ms.is_empty() || pace.done_ms.is_empty() || pace.n_at_work == 0 {
        return None;
    }
    let mean = mean_ms(pace);
    let left = |spent: &i64| (mean - *spent as f64).max(LEAST * mean);
    let all: f64 = pace.open_ms.iter().map(left).sum();
    // The tasks of a patient come one after the other, whatever number of workers is free.
    let longest = pace.open_ms.iter().map(left).fold(0.0, f64::max);
    Some((all / pace.n_at_work as f64).max(longest))
}

/// Expected end after [`left_ms`], with its basis in words.
#[must_use]
pub fn estimate(pace: &Pace, now_ms: i64) -> Option<Estimate> {
    Some(Estimate {
        end_ms: now_ms + left_ms(pace)?.round() as i64,
        basis: format!(
            "from {} that took {:.0} s each, and {} at work",
            count(pace.done_ms.len(), "finished patient"),
            mean_ms(pace) / 1e3,
            count(pace.n_at_work, "attempt")
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pace(done_ms: &[i64], open_ms: &[i64], n_at_work: usize) -> Pace {
        Pace {
            done_ms: done_ms.to_vec(),
            open_ms: open_ms.to_vec(),
            n_at_work,
        }
    }

    fn left(pace: &Pace) -> Option<i64> {
        estimate(pace, 1_000_000).map(|found| found.end_ms - 1_000_000)
    }

    #[test]
    fn work_is_shared_and_a_chain_is_not() {
        // 90 s are left of two patients, on two workers.
        assert_eq!(
            left(&pace(&[60_000, 60_000], &[0, 30_000], 2)),
            Some(60_000)
        );
        assert_eq!(left(&pace(&[60_000], &[0, 0, 0, 0], 2)), Some(120_000));
        assert_eq!(left(&pace(&[60_000], &[90_000], 1)), Some(6_000));
    }

    #[test]
    fn nothing_is_guessed_without_a_finished_patient_or_an_attempt_at_work() {
        assert_eq!(left(&pace(&[], &[0], 1)), None);
        assert_eq!(left(&pace(&[1], &[], 1)), None);
        assert_eq!(left(&pace(&[1], &[0], 0)), None);
    }
}
