//! Agreement of all ranks on an error of one of them.

use super::Communicator;

/// An error of this rank or of another one.
#[derive(Debug, Clone, PartialEq)]
pub enum Disagreement<E> {
    /// Error of this rank, which is the lowest rank with an error.
    Here(E),
    /// Text of another rank's error, with the number of the rank.
    Elsewhere(String),
}

/// Returns a success on all ranks or on none. If several ranks have errors, all ranks get that of
/// the lowest one. Collective.
///
/// # Errors
/// [`Disagreement`] on all ranks if one of them has an error.
pub fn agree<T, E: std::error::Error>(
    comm: &dyn Communicator,
    result: Result<T, E>,
) -> Result<T, Disagreement<E>> {
    if comm.n_ranks() == 1 {
        return result.map_err(Disagreement::Here);
    }
    let from_end = |rank: usize| (comm.n_ranks() - rank) as f64;
    let mut first = [if result.is_err() {
        from_end(comm.rank())
    } else {
        0.0
    }];
    comm.max(&mut first);
    if first[0] == 0.0 {
        return result.map_err(Disagreement::Here);
    }
    let rank = comm.n_ranks() - first[0] as usize;
    let own = result.err().filter(|_| rank == comm.rank());
    let words = own
        .as_ref()
        .map_or_else(Vec::new, |error| chain(error).into_bytes());
    let mut length = [words.len() as f64];
    comm.sum(&mut length);
    // Only one rank contributes a text.
    let mut bytes: Vec<f64> = words.into_iter().map(f64::from).collect();
    bytes.resize(length[0] as usize, 0.0);
    comm.sum(&mut bytes);
    match own {
        Some(error) => Err(Disagreement::Here(error)),
        None => {
            let bytes: Vec<u8> = bytes.into_iter().map(|b| b as u8).collect();
            Err(Disagreement::Elsewhere(format!(
                "rank {rank}: {}",
                String::from_utf8_lossy(&bytes)
            )))
        }
    }
}

fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        text += &format!(": {inner}");
        source = inner.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use std::num::ParseIntError;

    use super::super::{ThreadSettings, on_threads};
    use super::*;

    #[test]
    fn the_lowest_rank_that_fails_is_heard_everywhere() {
        let got = on_threads(4, ThreadSettings::default(), |comm| {
            let parsed = |text: &str| text.parse::<i32>();
            let good = agree(&comm, parsed("7"));
            let bad: Result<i32, Disagreement<ParseIntError>> = agree(
                &comm,
                parsed(if comm.rank() % 2 == 1 { "seven" } else { "7" }),
            );
            (good == Ok(7), bad)
        })
        .expect("no rank panics");
        let elsewhere = Disagreement::Elsewhere("rank 1: invalid digit found in string".to_owned());
        for (rank, (good, bad)) in got.into_iter().enumerate() {
            assert!(good);
            assert_eq!(matches!(bad, Err(Disagreement::Here(_))), rank == 1);
            assert!(rank == 1 || bad == Err(elsewhere.clone()));
        }
    }
}
