//! Shares of cases with their intervals.

use crate::classes::same_class;
use crate::{Case, Set};

/// Bands of visibility: names and lower ends.
pub const BANDS: [(&str, f64); 4] = [
    ("limit", f64::MIN),
    ("weak", 20.0),
    ("moderate", 50.0),
    ("strong", 150.0),
];

/// A share of cases.
#[derive(Clone, Copy, Default)]
pub struct Rate {
    /// Number of cases with the property.
    pub hits: usize,
    /// Number of cases.
    pub of: usize,
}

impl Rate {
    /// Counts the cases with a property.
    pub fn of<'a>(cases: impl Iterator<Item = &'a Case>, hit: impl Fn(&Case) -> bool) -> Self {
        cases.fold(Self::default(), |r, c| Self {
            hits: r.hits + usize::from(hit(c)),
            of: r.of + 1,
        })
    }

    /// The share; zero without cases.
    pub fn share(self) -> f64 {
        self.hits as f64 / self.of.max(1) as f64
    }

    /// 95 % interval (Wilson 1927).
    pub fn interval(self) -> (f64, f64) {
        let (n, p, z) = (self.of.max(1) as f64, self.share(), 1.96);
        let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        ((middle - half).max(0.0), (middle + half).min(1.0))
    }

    /// The share as text.
    pub fn words(self) -> String {
        let (low, high) = self.interval();
        let percent = |x: f64| 100.0 * x;
        format!(
            "{} of {} ({:.0} %, 95 % interval {:.0} to {:.0} %)",
            self.hits,
            self.of,
            percent(self.share()),
            percent(low),
            percent(high)
        )
    }
}

/// Whether the first name is the hidden effect.
pub fn right_first(case: &Case) -> bool {
    case.single()
        .is_some_and(|(truth, _)| case.named.first() == Some(truth))
}

/// Whether the first name is the hidden effect or looks like it.
pub fn right_class(case: &Case) -> bool {
    case.single()
        .is_some_and(|(truth, _)| case.named.first().is_some_and(|n| same_class(n, truth)))
}

/// Cases with one hidden effect.
pub fn singles(set: &Set) -> impl Iterator<Item = &Case> {
    set.cases.iter().filter(|c| c.single().is_some())
}

/// Index of a case's band of visibility.
pub fn band(case: &Case) -> Option<usize> {
    let seen = case.visibility?;
    BANDS.iter().rposition(|(_, low)| seen >= *low)
}

/// Whether the data can show the effects of a case.
pub fn is_visible(case: &Case) -> bool {
    !case.hard && band(case).is_none_or(|b| b > 0)
}
