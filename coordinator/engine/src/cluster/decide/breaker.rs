//! Circuit breaker for Slurm: after several commands without an answer, no command is sent for a
//! while. More queries do not help a controller in trouble, and each of them may hang for a minute.

use cardiotwin_store::clock;

use super::State;

/// Number of consecutive commands without an answer after which Slurm is left alone.
const PATIENCE: u32 = 3;
/// Length above which the pause does not grow \[ms\].
const LONGEST_MS: i64 = 3_600_000;

/// Length of the pause after `silent` consecutive commands without an answer, ms; `None` if no
/// pause is due yet.
fn pause_ms(silent: u32, grace_s: u64) -> Option<i64> {
    let further = silent.checked_sub(PATIENCE)?;
    let grace_ms = i64::try_from(grace_s)
        .unwrap_or(LONGEST_MS)
        .saturating_mul(1000);
    Some(
        grace_ms
            .saturating_mul(1 << further.min(12))
            .min(LONGEST_MS),
    )
}

impl State {
    /// Whether a pause is in effect.
    pub(super) fn leaves_slurm_alone(&self) -> bool {
        self.books.now_ms() < self.report.asks_again_ms
    }

    /// Records whether a command was answered. After [`PATIENCE`] consecutive commands without an
    /// answer, Slurm is left alone for the grace time, which doubles with each further one.
    pub(super) fn count_silence(&mut self, unanswered: Option<&str>) {
        let Some(why) = unanswered else {
            (self.report.silent, self.report.asks_again_ms) = (0, 0);
            return;
        };
        self.report.silent += 1;
        if let Some(pause_ms) = pause_ms(self.report.silent, self.settings.slurm.grace_s) {
            self.report.asks_again_ms = self.books.now_ms() + pause_ms;
            let (n, until) = (
                self.report.silent,
                clock::utc_text(self.report.asks_again_ms),
            );
            self.report.no_answer = Some(format!(
                "no commands until {until}, after {n} commands without an answer: {why}"
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::pause_ms;

    #[test]
    fn pauses_double_from_the_third_silence_on_up_to_an_hour() {
        let pauses: Vec<Option<i64>> = (1..=9).map(|silent| pause_ms(silent, 120)).collect();
        let s = |seconds: i64| Some(seconds * 1000);
        assert_eq!(
            pauses,
            [
                None,
                None,
                s(120),
                s(240),
                s(480),
                s(960),
                s(1920),
                s(3600),
                s(3600)
            ]
        );
        assert_eq!(
            (pause_ms(u32::MAX, 1), pause_ms(7, u64::MAX), pause_ms(7, 0)),
            (s(3600), s(3600), s(0))
        );
    }
}
