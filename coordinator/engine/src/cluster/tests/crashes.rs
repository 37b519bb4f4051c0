//! Coordinators and drivers that die at each of their crash points: around every commit, file
//! action and command. The next tick continues, and the end is the same.

use cardiotwin_slurm_model::{Fault, Settings};

use super::lab::Lab;
use super::noops;
use crate::cancel;
use crate::crash::CrashPoints;

/// Events that accompany the run. Each course leads the coordinator through other actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Course {
    /// Everything goes as planned.
    Peaceful,
    /// The first submission takes effect, but its answer is lost.
    DoubtfulSubmission,
    /// A driver dies at its second attempt and its node is lost: the job is settled and the attempt
    /// revoked.
    LostNode,
    /// A person cancels the run while its job waits or runs: `scancel`.
    Cancelled,
}

const COURSES: [Course; 4] = [
    Course::Peaceful,
    Course::DoubtfulSubmission,
    Course::LostNode,
    Course::Cancelled,
];

impl Course {
    /// Runs the course with coordinators and drivers that die at these crash points, and ends it
    /// with others that do not. Returns the lab, and whether any of them died.
    async fn live(self, coordinator: &CrashPoints, driver: &CrashPoints) -> (Lab, bool) {
        let mut lab = Lab::new(
            noops(2),
            Settings {
                n_nodes: 2,
                ..Settings::default()
            },
        );
        if self == Self::DoubtfulSubmission {
            lab.fault("sbatch", Fault::TimeoutAfter);
        }
        let mut is_cancelled = false;
        for round in 0..40 {
            match lab.tick_until(coordinator).await {
                Err(error) => {
                    assert!(error.to_string().contains("crash point"), "{error}");
                    break;
                }
                Ok(summary) if !summary.on_cluster() => break,
                Ok(_) => {}
            }
            lab.pass(30);
            match (self, round) {
                (Self::Cancelled, 0) => {
                    cancel(&lab.run_dir(), None).await.unwrap();
                    is_cancelled = true;
                }
                (Self::LostNode, 0) => {
                    lab.drive_until(|| Some((1, true)), driver).await;
                    lab.slurm.model.lock().unwrap().lose_node(1);
                }
                _ => lab.drive_until(|| None, driver).await,
            }
        }
        let has_died = coordinator.is_over() || driver.is_over();
        lab.moment();
        if self == Self::Cancelled && !is_cancelled {
            lab.tick().await; // The coordinator died before there was anything to cancel.
            cancel(&lab.run_dir(), None).await.unwrap();
        }
        let summary = lab.finish().await;
        let found = (summary.done, summary.failed, summary.cancelled);
        let expected = match self {
            Self::Cancelled => (0, 0, 2),
            _ => (2, 0, 0),
        };
        assert_eq!(found, expected, "{self:?} {coordinator:?} {driver:?}");
        lab.assert_published_once().await;
        (lab, has_died)
    }
}

#[tokio::test]
async fn a_tick_killed_at_any_point_is_continued() {
    for course in COURSES {
        let mut n_points = 0;
        for point in 1.. {
            let crash = CrashPoints::ending_at(point);
            let (lab, died) = course.live(&crash, &CrashPoints::default()).await;
            if matches!(course, Course::Peaceful | Course::DoubtfulSubmission) {
                assert_eq!(
                    lab.attempts(),
                    (6, 6),
                    "nothing was done twice: {course:?}, point {point}"
                );
            }
            if !died {
                break;
            }
            n_points = point;
        }
        eprintln!("{course:?}: {n_points} crash points");
        assert!(
            n_points > 20,
            "{course:?}: only {n_points} crash points: are they still there?"
        );
    }
}

#[tokio::test]
async fn a_driver_killed_at_any_point_is_continued() {
    for course in [Course::Peaceful, Course::LostNode] {
        let mut n_points = 0;
        for point in 1.. {
            let crash = CrashPoints::ending_at(point);
            let (_, died) = course.live(&CrashPoints::default(), &crash).await;
            if !died {
                break;
            }
            n_points = point;
        }
        eprintln!("{course:?}: {n_points} crash points of drivers");
        assert!(
            n_points > 10,
            "{course:?}: only {n_points} crash points: are they still there?"
        );
    }
}
