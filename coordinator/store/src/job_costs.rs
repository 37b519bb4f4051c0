//! What each element of a run's jobs cost: waiting, time, node-hours.

use std::collections::HashMap;

use cardiotwin_schemas::status::JobState;

use crate::cluster_jobs::{ClusterReport, JobRow, id_text};

/// Costs of a job, or of one element of an array.
#[derive(Debug, Clone, PartialEq)]
pub struct ElementCost {
    /// Scheduler's number, or the job's name while the number is unknown.
    pub id: String,
    /// Unique name of the job.
    pub name: String,
    /// Name of the queue in the site's profile.
    pub queue: String,
    /// State of the element.
    pub state: JobState,
    /// Number of nodes, or the share of a node, that is charged.
    pub nodes: f64,
    /// Its patients, in their order in the element.
    pub patients: Vec<String>,
    /// Time of the decision to submit, milliseconds since 1970.
    pub intended_ms: i64,
    /// Time from the decision to the start \[s\]; `None` before the start.
    pub waited_s: Option<f64>,
    /// Time from the start to the end, or until now \[s\]; `None` before the start.
    pub ran_s: Option<f64>,
}

impl ElementCost {
    /// Node-hours until now.
    #[must_use]
    pub fn node_hours(&self) -> f64 {
        self.ran_s.unwrap_or(0.0) / 3600.0 * self.nodes
    }
}

/// Costs of all elements, in the order of submission, and what a node-hour costs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JobCosts {
    /// One for each element.
    pub elements: Vec<ElementCost>,
    /// Charge per node-hour, in `charge_unit`.
    pub charge_per_node_hour: f64,
    /// Unit of the charge; empty where the site has none.
    pub charge_unit: String,
}

/// - `names`: patients by row id; `now_ms`: milliseconds since 1970
pub(super) fn costs(
    report: &ClusterReport,
    jobs: &[JobRow],
    names: &HashMap<i64, String>,
    now_ms: i64,
) -> JobCosts {
    let of_element = |row: &JobRow, element: usize| {
        let seen = &row.seen[element];
        let state = row.state.shown(element);
        // A waiting job may have an expected start.
        let start_s = seen.start_s.filter(|_| state != JobState::Waiting);
        let until_now = || Some((now_ms / 1000 - start_s?).max(0) as f64);
        let is_over = seen.settled || row.over;
        ElementCost {
            id: id_text(row, element),
            name: row.name.clone(),
            queue: row.spec.queue.clone(),
            state,
            nodes: row.spec.nodes_charged,
            patients: (row.spec.elements[element].iter())
                .filter_map(|placed| names.get(&placed.patient_id).cloned())
                .collect(),
            intended_ms: row.intended_ms,
            waited_s: start_s
                .map(|start| (start as f64 - row.intended_ms as f64 / 1000.0).max(0.0)),
            ran_s: (seen.elapsed_s.map(|s| s as f64)).or_else(|| until_now().filter(|_| !is_over)),
        }
    };
    let elements = jobs
        .iter()
        .flat_map(|row| (0..row.seen.len()).map(move |element| of_element(row, element)));
    JobCosts {
        elements: elements.collect(),
        charge_per_node_hour: report.charge_per_node_hour,
        charge_unit: report.charge_unit.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster_jobs::{JobSpec, Placed, SeenElement};
    use cardiotwin_workflow::cluster_job::{ClusterJob, Element, Submission};

    fn job(elements: &[Element], seen: &[SeenElement]) -> JobRow {
        let placed = |patient_id| Placed {
            patient_id,
            settled: 0,
            plan: 1,
        };
        JobRow {
            name: "ct-a".to_owned(),
            version: 1,
            over: false,
            state: ClusterJob {
                submission: Submission::Accepted { job: Some(42) },
                elements: elements.to_vec(),
            },
            spec: JobSpec {
                queue: "standard".to_owned(),
                is_array: true,
                nodes_charged: 2.0,
                elements: vec![vec![placed(1), placed(2)], vec![placed(3)]],
                ..JobSpec::default()
            },
            seen: seen.to_vec(),
            intended_ms: 1_000_000,
        }
    }

    #[test]
    fn elements_wait_until_they_start_and_cost_until_they_end() {
        let ended = SeenElement {
            start_s: Some(1060),
            elapsed_s: Some(1800),
            settled: true,
            ..SeenElement::default()
        };
        // Slurm expects a start that has not come.
        let waiting = SeenElement {
            start_s: Some(9999),
            ..SeenElement::default()
        };
        let row = job(&[Element::Running, Element::Waiting], &[ended, waiting]);
        let report = ClusterReport {
            charge_per_node_hour: 1.5,
            charge_unit: "CU".to_owned(),
            ..ClusterReport::default()
        };
        let names = HashMap::from([
            (1, "A".to_owned()),
            (2, "B".to_owned()),
            (3, "C".to_owned()),
        ]);
        let found = costs(&report, &[row], &names, 4_000_000);
        let [first, second] = &found.elements[..] else {
            panic!("{found:?}")
        };
        assert_eq!(
            (&first.id[..], &first.patients[..]),
            ("42_0", &["A".to_owned(), "B".to_owned()][..])
        );
        assert_eq!(
            (first.waited_s, first.ran_s, first.node_hours()),
            (Some(60.0), Some(1800.0), 1.0)
        );
        assert_eq!(
            (second.waited_s, second.ran_s, second.node_hours()),
            (None, None, 0.0)
        );
        assert_eq!(
            (found.charge_per_node_hour, &found.charge_unit[..]),
            (1.5, "CU")
        );
    }
}
