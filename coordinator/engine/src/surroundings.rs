//! Clock and crash points of an engine.

use cardiotwin_store::clock::Clock;

use super::crash::CrashPoints;

/// The clock that an engine reads, and the points where tests let it die.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Clock for every time that the engine writes down or compares.
    pub clock: Clock,
    /// Passed before and after commits, actions and commands.
    pub(crate) crash: CrashPoints,
}

impl Surroundings {
    /// The wall clock, and the crash points set in the environment.
    pub fn of_this_process() -> Self {
        Self {
            clock: Clock::Wall,
            crash: CrashPoints::from_environment(),
        }
    }
}
