//! Waiting of a coordinator for another program that has locked the run's database.

use cardiotwin_store::{Patience, Waiting};

use super::{EngineEvent, EventSender, StopLevel, StopSignal};

/// Wait after which it is told \[ms\]. Shorter ones are those of a backup.
const TOLD_AFTER_MS: i64 = 2_000;
/// Time after which it is told again \[ms\].
const TOLD_AGAIN_MS: i64 = 300_000;

/// Waits until the lock is gone or a second stop is asked for, and tells for whom. Workers continue
/// meanwhile.
pub(super) fn until_stopped(events: &EventSender, stop: &StopSignal) -> Patience {
    let (events, stop) = (events.clone(), stop.clone());
    let mut told: Option<(String, i64)> = None;
    Patience::new(move |waiting| {
        if is_news(told.as_ref(), waiting) {
            told = Some((waiting.since.clone(), waiting.waited_ms));
            // There may be no receiver.
            let _ = events.send(EngineEvent::DatabaseLocked {
                waiting: waiting.clone(),
            });
        }
        stop.level() < StopLevel::Now
    })
}

/// Whether a wait is to be told. `told`: beginning of the last wait that was told, and how long it
/// had lasted then.
fn is_news(told: Option<&(String, i64)>, waiting: &Waiting) -> bool {
    let since_told = match told {
        Some((since, at_ms)) if *since == waiting.since => waiting.waited_ms - at_ms,
        _ => return waiting.waited_ms >= TOLD_AFTER_MS,
    };
    since_told >= TOLD_AGAIN_MS
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waiting(since: &str, waited_ms: i64) -> Waiting {
        Waiting {
            file: "run/cardiotwin.db".into(),
            holder: "process 7 (sqlite3)".into(),
            since: since.into(),
            waited_ms,
        }
    }

    #[test]
    fn a_long_wait_is_told_once_and_again_after_five_minutes() {
        let told = ("a".to_owned(), 2_500);
        for (before, now, wanted) in [
            (None, waiting("a", 500), false),
            (None, waiting("a", 2_500), true),
            (Some(&told), waiting("a", 9_000), false),
            (Some(&told), waiting("a", 302_500), true),
            (Some(&told), waiting("b", 500), false),
            (Some(&told), waiting("b", 2_000), true),
        ] {
            assert_eq!(is_news(before, &now), wanted, "{before:?} {now:?}");
        }
    }

    #[test]
    fn a_second_stop_ends_the_wait() {
        let (events, _) = tokio::sync::mpsc::unbounded_channel();
        let stop = StopSignal::new();
        let mut patience = until_stopped(&events, &stop);
        assert!(patience.goes_on(&waiting("a", 900_000)));
        stop.ask();
        assert!(patience.goes_on(&waiting("a", 900_001)));
        stop.ask();
        assert!(!patience.goes_on(&waiting("a", 900_002)));
    }
}
