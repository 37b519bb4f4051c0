//! Work of a search for a passive state, in iterations.

/// Work of a search, including failed equilibria.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SearchWork {
    /// Number of Newton iterations.
    pub newton_iterations: usize,
    /// Number of iterations of linear solvers.
    pub krylov_iterations: usize,
}

impl SearchWork {
    /// Whether either count is larger than its limit.
    pub(super) fn exceeds(self, most: Self) -> bool {
        self.newton_iterations > most.newton_iterations
            || self.krylov_iterations > most.krylov_iterations
    }
}
