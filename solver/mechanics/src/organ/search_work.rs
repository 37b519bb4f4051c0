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
    /// Work since `before`.
    pub(super) fn since(self, before: Self) -> Self {
        Self {
            newton_iterations: self.newton_iterations - before.newton_iterations,
            krylov_iterations: self.krylov_iterations - before.krylov_iterations,
        }
    }

    /// Whether either count is larger than its limit.
    pub(super) fn exceeds(self, most: Self) -> bool {
        self.newton_iterations > most.newton_iterations
            || self.krylov_iterations > most.krylov_iterations
    }
}
