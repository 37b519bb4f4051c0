//! Tests of all operations with more ranks than cores, and of all kinds of failure.

use std::sync::mpsc::channel;

use super::super::Neighbour;
use super::*;

#[test]
fn reductions_give_all_ranks_the_same_bits_in_the_order_of_ranks() {
    for n_ranks in [1, 2, 3, 5, 8] {
        let value =
            |rank: usize, round: usize, k: usize| ((rank * 7 + round * 3 + k) as f64 * 0.37).sin();
        let got = on_threads(n_ranks, ThreadSettings::default(), |comm| {
            let mut seen = vec![];
            for round in 0..300 {
                // More values than one post holds.
                let mut values: Vec<f64> = (0..20).map(|k| value(comm.rank(), round, k)).collect();
                let mut largest = [values[0], -1.0];
                comm.sum(&mut values);
                comm.max(&mut largest);
                let mut word = [comm.rank() as f64 + 1.0, round as f64];
                comm.broadcast(&mut word);
                seen.extend(values.into_iter().chain(largest).chain(word));
            }
            seen
        })
        .expect("no rank fails");
        assert!(got.iter().all(|of| *of == got[0]));
        for (round, seen) in got[0].chunks(24).enumerate() {
            for k in 0..20 {
                let want =
                    (1..n_ranks).fold(value(0, round, k), |sum, rank| sum + value(rank, round, k));
                assert_eq!(seen[k], want);
            }
            let want = (0..n_ranks)
                .map(|rank| value(rank, round, 0))
                .fold(f64::MIN, f64::max);
            assert_eq!(seen[20..], [want, -1.0, 1.0, round as f64]);
        }
    }
}

#[test]
fn a_number_that_is_none_spoils_the_largest() {
    let got = on_threads(3, ThreadSettings::default(), |comm| {
        let mut value = [if comm.rank() == 1 { f64::NAN } else { 1.0 }];
        comm.max(&mut value);
        value[0].is_nan()
    });
    assert_eq!(got, Ok(vec![true; 3]));
}

#[test]
fn ghosts_gathers_and_scatters_bring_what_others_hold() {
    // A ring of ranks. Each owns two nodes and holds the second node of its predecessor and the
    // first node of its successor.
    let n_ranks = 4;
    let got = on_threads(n_ranks, ThreadSettings::default(), |comm| {
        let (rank, n) = (comm.rank(), comm.n_ranks());
        let mut neighbours = vec![
            Neighbour {
                rank: (rank + n - 1) % n,
                send: vec![0],
                receive: vec![2],
            },
            Neighbour {
                rank: (rank + 1) % n,
                send: vec![1],
                receive: vec![3],
            },
        ];
        neighbours.sort_by_key(|neighbour| neighbour.rank);
        let layout = Layout {
            n_owned: 2,
            n_local: 4,
            neighbours,
        };
        let mut seen = vec![];
        for round in 0..200 {
            let own = |rank: usize, node: usize| [(rank * 10 + node) as f64, round as f64];
            let mut values = [own(rank, 0), own(rank, 1), [-1.0; 2], [-1.0; 2]].concat();
            comm.update_ghosts(&layout, 2, &mut values);
            let want = [
                own(rank, 0),
                own(rank, 1),
                own((rank + n - 1) % n, 1),
                own((rank + 1) % n, 0),
            ]
            .concat();
            assert_eq!(values, want);
            let all = comm.gather(&values[..rank + 1]);
            assert_eq!(all.is_some(), rank == 0);
            let lengths = all.iter().flatten().map(Vec::len).collect::<Vec<_>>();
            assert_eq!(lengths, if rank == 0 { vec![1, 2, 3, 4] } else { vec![] });
            seen = comm.scatter(all.unwrap_or_default());
            assert_eq!(seen, values[..rank + 1]);
        }
        seen.len()
    });
    assert_eq!(got, Ok(vec![1, 2, 3, 4]));
}

#[test]
fn a_panic_on_one_rank_ends_all_with_its_name_and_reason() {
    for failing in [0, 2] {
        let got = on_threads(4, ThreadSettings::default(), |comm| {
            for round in 0.. {
                if round == 20 && comm.rank() == failing {
                    resume_unwind(Box::new(format!("element {} is torn", 7)));
                }
                comm.sum(&mut [1.0]);
            }
        });
        let failure = got.expect_err("one rank fails");
        assert_eq!(
            failure.to_string(),
            format!("rank {failing} of 4: element 7 is torn")
        );
    }
}

#[test]
fn a_rank_that_leaves_early_is_told() {
    let got = on_threads(2, ThreadSettings::default(), |comm| {
        if comm.rank() == 0 {
            comm.sum(&mut [1.0]);
        }
    });
    assert_eq!(
        got.expect_err("it waits").to_string(),
        "rank 0 of 2: rank 1 has left, and will not do its part"
    );
}

#[test]
fn a_rank_that_makes_no_progress_ends_the_group() {
    let (word, stuck) = channel::<()>();
    let stuck = Mutex::new(stuck);
    let word = Mutex::new(Some(word));
    let short = ThreadSettings {
        patience: Duration::from_millis(50),
    };
    let got = on_threads(3, short, |comm| match comm.rank() {
        // Waits until rank 0 gives up.
        1 => drop(locked(&stuck).recv()),
        0 => {
            let waited = catch_unwind(AssertUnwindSafe(|| comm.sum(&mut [1.0])));
            drop(locked(&word).take());
            resume_unwind(waited.expect_err("rank 1 is stuck"));
        }
        _ => {}
    });
    let failure = got.expect_err("rank 1 is stuck");
    assert_eq!(
        failure.to_string(),
        "rank 0 of 3: no progress: waited 0.05 s for rank 1"
    );
}

#[test]
fn a_crew_serves_until_it_is_dropped() {
    let (say, hear) = channel();
    let (first, crew) = crew(3, ThreadSettings::default(), |rank| {
        let say = say.clone();
        move |comm: ThreadRank| {
            loop {
                let mut word = [0.0];
                comm.command(&mut word);
                let mut sum = [word[0] * rank as f64];
                comm.sum(&mut sum);
                say.send(sum[0]).expect("somebody listens");
            }
        }
    })
    .expect("threads");
    for k in 1..4 {
        first.command(&mut [f64::from(k)]);
        let mut sum = [0.0];
        first.sum(&mut sum);
        assert_eq!(sum[0], 3.0 * f64::from(k));
    }
    assert_eq!(crew.failure(), None);
    drop(crew);
    drop(say);
    assert_eq!(hear.iter().count(), 6);
}

#[test]
fn rank_0_unwinds_with_the_failure_of_its_crew() {
    let (first, crew) = crew(2, ThreadSettings::default(), |_| {
        |comm: ThreadRank| {
            comm.sum(&mut [1.0]);
            resume_unwind(Box::new("out of luck"));
        }
    })
    .expect("threads");
    first.sum(&mut [1.0]);
    let payload =
        catch_unwind(AssertUnwindSafe(|| first.sum(&mut [1.0]))).expect_err("rank 1 fails");
    assert_eq!(text(payload.as_ref()), "rank 1 of 2: out of luck");
    assert_eq!(crew.failure().map(|f| f.rank), Some(1));
}
