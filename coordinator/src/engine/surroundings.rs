//! What an engine is given beside its task.

use super::crash::CrashPoints;
use crate::clock::Clock;

/// The clock that an engine reads, and where tests let it die.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Read for every time that the engine writes down or compares.
    pub clock: Clock,
    /// Passed around commits, actions and commands.
    pub crash: CrashPoints,
}

impl Surroundings {
    /// The wall clock, and crash points as the environment asks.
    pub fn of_this_process() -> Self {
        Self {
            clock: Clock::Wall,
            crash: CrashPoints::from_environment(),
        }
    }
}
