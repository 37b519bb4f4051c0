//! Report of a repair.

/// Report of a repair.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Done {
    /// Descriptions of the steps, with their counts.
    pub steps: Vec<String>,
}

impl Done {
    pub(super) fn count(&mut self, n: usize, one: &str, many: &str) {
        match n {
            0 => {}
            1 => self.steps.push(format!("1 {one}")),
            n => self.steps.push(format!("{n} {many}")),
        }
    }
}
