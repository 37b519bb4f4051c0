//! The reaction-eikonal model: an eikonal solution triggers action potentials, and the monodomain
//! equation determines their shape.
//!
//! Source: Neic, Campos, Prassl, Niederer, Bishop, Vigmond, Plank 2017, "Efficient computation of
//! electrograms and ECGs in human whole heart simulations using a reaction-eikonal model", J.
//! Comput. Phys. 346, 191. With diffusion it is their R-E+, without diffusion their R-E−. The time
//! steps use Godunov's splitting: foot current and membrane, then diffusion.

use crate::crossings::Crossings;
use crate::diffusion::Diffusion;
use crate::foot::{Feet, FootCurrent};
use crate::luo_rudy1991::cells::{Cells, Membrane};
use crate::luo_rudy1991::{Parameters, State};
use crate::tissue::Tissue;
use cardiotwin_linalg::vec3::norm;
use cardiotwin_mesh::TetMesh;

/// Settings of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Time step of membrane and diffusion \[ms\].
    pub step_ms: f64,
    /// Whether the potential diffuses: R-E+ with diffusion, R-E− without.
    pub diffusion: bool,
    /// Current that triggers action potentials.
    pub foot: FootCurrent,
    /// Cycle length after which every node is activated again \[ms\]; `None` for a single
    /// activation.
    pub cycle_ms: Option<f64>,
    /// Constants of the membrane model.
    pub membrane: Parameters,
}

impl Default for Settings {
    /// R-E+ with steps of 0.025 ms and one activation.
    fn default() -> Self {
        Self {
            step_ms: 0.025,
            diffusion: true,
            foot: FootCurrent::default(),
            cycle_ms: None,
            membrane: Parameters::default(),
        }
    }
}

/// Reasons why the model cannot be set up or cannot continue.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ElectrophysiologyError {
    /// A value that must be positive is not.
    #[error("electrophysiology: {what} is {found}, expected a positive number")]
    NotPositive {
        /// Name of the value.
        what: &'static str,
        /// Value that was given.
        found: f64,
    },
    /// No element has a conducting tag.
    #[error("electrophysiology: no element has one of the conducting tags {tags:?}")]
    NoTissue {
        /// Tags that conduct.
        tags: Vec<i32>,
    },
    /// An element is not usable.
    #[error("electrophysiology: element {element} {problem}")]
    Element {
        /// Index of the element.
        element: usize,
        /// Problem of the element and its remedy.
        problem: &'static str,
    },
    /// The number of activation times differs from that of the mesh's nodes.
    #[error(
        "electrophysiology: found {found} activation times for a mesh of {expected} nodes: check that the file \
         belongs to this mesh"
    )]
    HowManyTimes {
        /// Number of activation times.
        found: usize,
        /// Number of nodes in the mesh.
        expected: usize,
    },
    /// An activation time is out of range.
    #[error("electrophysiology: node {node} is activated at {found} ms, expected {expected}")]
    ActivationTime {
        /// Node of the mesh.
        node: usize,
        /// Activation time of the node \[ms\].
        found: f64,
        /// Description of valid times.
        expected: String,
    },
    /// A potential is not finite.
    #[error(
        "electrophysiology: the potential of node {node} is {found} mV at {t_ms} ms: try a shorter step"
    )]
    Diverged {
        /// Node of the mesh.
        node: usize,
        /// Potential of the node \[mV\].
        found: f64,
        /// Time of the failing step \[ms\].
        t_ms: f64,
    },
    /// The linear solver did not converge.
    #[error(
        "electrophysiology: diffusion at {t_ms} ms stalled at a residual of {error_mv:.1e} mV: look for degenerate \
         elements"
    )]
    Stalled {
        /// Time of the failing step \[ms\].
        t_ms: f64,
        /// Residual that was reached \[mV\].
        error_mv: f64,
    },
    /// The snapshot belongs to another model.
    #[error("electrophysiology: the snapshot has {found} conducting nodes, expected {expected}")]
    Snapshot {
        /// Number of conducting nodes in the snapshot.
        found: usize,
        /// Number of conducting nodes in the model.
        expected: usize,
    },
}

/// The complete time-dependent state, for checkpoints. For the same mesh, activation and settings,
/// a run from a snapshot equals the uninterrupted run bit for bit.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Number of completed steps.
    pub n_steps: u64,
    /// States of the conducting nodes.
    pub cells: Cells,
    /// Crossings of the conducting nodes.
    pub crossings: Crossings,
}

/// The model on a mesh.
#[derive(Debug, Clone)]
pub struct ReactionEikonal {
    n_mesh_nodes: usize,
    nodes: Vec<u32>,
    membrane: Membrane,
    diffusion: Option<Diffusion>,
    feet: Feet,
    now: Snapshot,
    before_mv: Vec<f64>,
    n_iterations: u64,
}

impl ReactionEikonal {
    /// The model on the elements of `mesh` with one of `tags`.
    ///
    /// - `activation_ms`: activation time of each node of the mesh, from
    ///   [`cardiotwin_mesh::eikonal::activation_ms`] or a file. Times of nodes that do not conduct
    ///   are ignored. A conducting node that only diffusion activates has an infinite time.
    /// - `start`: state of all cells at time zero, from [`crate::luo_rudy1991::paced::rest`] or
    ///   [`crate::luo_rudy1991::paced::paced`].
    ///
    /// # Errors
    /// [`ElectrophysiologyError`] if a value, an element or a time is out of range.
    pub fn new(
        mesh: &TetMesh,
        tags: &[i32],
        activation_ms: &[f64],
        tissue: &Tissue,
        start: &State,
        settings: &Settings,
    ) -> Result<Self, ElectrophysiologyError> {
        check_numbers(tissue, settings)?;
        if activation_ms.len() != mesh.n_nodes() {
            return Err(ElectrophysiologyError::HowManyTimes {
                found: activation_ms.len(),
                expected: mesh.n_nodes(),
            });
        }
        let elements: Vec<usize> = (0..mesh.n_tets())
            .filter(|e| tags.contains(&mesh.tags[*e]))
            .collect();
        if elements.is_empty() {
            return Err(ElectrophysiologyError::NoTissue {
                tags: tags.to_vec(),
            });
        }
        check_elements(mesh, &elements, settings.diffusion)?;
        let mut place = vec![u32::MAX; mesh.n_nodes()];
        for node in elements.iter().flat_map(|e| mesh.tets[*e]) {
            place[node as usize] = 0;
        }
        let nodes: Vec<u32> = (0..mesh.n_nodes() as u32)
            .filter(|node| place[*node as usize] == 0)
            .collect();
        for (i, node) in nodes.iter().enumerate() {
            place[*node as usize] = i as u32;
        }
        let times: Vec<f64> = nodes
            .iter()
            .map(|node| activation_ms[*node as usize])
            .collect();
        check_times(&nodes, &times, settings)?;
        let diffusion = settings.diffusion.then(|| {
            let positions: Vec<_> = nodes
                .iter()
                .map(|node| mesh.nodes_mm[*node as usize])
                .collect();
            let tets: Vec<_> = elements
                .iter()
                .map(|e| mesh.tets[*e].map(|node| place[node as usize]))
                .collect();
            let frames: Vec<_> = elements.iter().map(|e| mesh.frames[*e]).collect();
            Diffusion::new(
                &positions,
                &tets,
                &frames,
                tissue.diffusivities_mm2_ms(),
                settings.step_ms,
            )
        });
        let n = nodes.len();
        Ok(Self {
            n_mesh_nodes: mesh.n_nodes(),
            nodes,
            membrane: Membrane::new(
                Parameters {
                    capacitance_uf_cm2: tissue.capacitance_uf_cm2,
                    ..settings.membrane.clone()
                },
                settings.step_ms,
            ),
            diffusion,
            feet: Feet::new(settings.foot, &times, settings.cycle_ms),
            now: Snapshot {
                n_steps: 0,
                cells: Cells::new(n, start),
                crossings: Crossings::new(n),
            },
            before_mv: vec![0.0; n],
            n_iterations: 0,
        })
    }

    /// Time that the model has reached \[ms\].
    #[must_use]
    pub fn t_ms(&self) -> f64 {
        self.now.n_steps as f64 * self.membrane.step_ms()
    }

    /// Advances to the first step at or after `t_ms`.
    ///
    /// # Errors
    /// [`ElectrophysiologyError::Diverged`] or [`ElectrophysiologyError::Stalled`]; the state is
    /// then invalid.
    pub fn advance_to(&mut self, t_ms: f64) -> Result<(), ElectrophysiologyError> {
        while self.t_ms() < t_ms - 1e-6 * self.membrane.step_ms() {
            self.step()?;
        }
        self.check_finite()
    }

    fn step(&mut self) -> Result<(), ElectrophysiologyError> {
        let from = self.t_ms();
        let cells = &mut self.now.cells;
        self.before_mv.copy_from_slice(&cells.v_mv);
        self.feet
            .add(from, from + self.membrane.step_ms(), &mut cells.v_mv);
        cells.step(&self.membrane);
        let solved = self
            .diffusion
            .as_mut()
            .map_or(Ok(0), |diffusion| diffusion.step(&mut cells.v_mv));
        self.now.n_steps += 1;
        let t_ms = self.t_ms();
        match solved {
            Ok(iterations) => self.n_iterations += iterations as u64,
            Err(stalled) => {
                self.check_finite()?;
                return Err(ElectrophysiologyError::Stalled {
                    t_ms,
                    error_mv: stalled.error,
                });
            }
        }
        self.now.crossings.note(
            &self.before_mv,
            &self.now.cells.v_mv,
            t_ms,
            self.membrane.step_ms(),
        );
        Ok(())
    }

    fn check_finite(&self) -> Result<(), ElectrophysiologyError> {
        match self.now.cells.v_mv.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(i) => Err(ElectrophysiologyError::Diverged {
                node: self.nodes[i] as usize,
                found: self.now.cells.v_mv[i],
                t_ms: self.t_ms(),
            }),
        }
    }

    /// Conducting nodes of the mesh in ascending order, which is the order of all arrays in a
    /// [`Snapshot`].
    #[must_use]
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Transmembrane potential of each node of the mesh \[mV\]; not-a-number at nodes that do not
    /// conduct.
    #[must_use]
    pub fn potential_mv(&self) -> Vec<f64> {
        self.on_mesh(&self.now.cells.v_mv)
    }

    /// Maps values of the conducting nodes to all nodes of the mesh; not-a-number at other nodes.
    ///
    /// # Panics
    /// If there are fewer values than conducting nodes.
    #[must_use]
    pub fn on_mesh(&self, values: &[f64]) -> Vec<f64> {
        let mut all = vec![f64::NAN; self.n_mesh_nodes];
        for (i, node) in self.nodes.iter().enumerate() {
            all[*node as usize] = values[i];
        }
        all
    }

    /// Times of depolarisation and repolarisation, in the order of [`ReactionEikonal::nodes`].
    #[must_use]
    pub fn crossings(&self) -> &Crossings {
        &self.now.crossings
    }

    /// Mean number of solver iterations per step since the model was made.
    #[must_use]
    pub fn mean_iterations(&self) -> f64 {
        self.n_iterations as f64 / self.now.n_steps.max(1) as f64
    }

    /// The state, for a checkpoint.
    #[must_use]
    pub fn snapshot(&self) -> &Snapshot {
        &self.now
    }

    /// Continues from a snapshot of the same mesh, activation and settings.
    ///
    /// # Errors
    /// [`ElectrophysiologyError::Snapshot`] if its size differs.
    pub fn restore(&mut self, snapshot: Snapshot) -> Result<(), ElectrophysiologyError> {
        let expected = self.nodes.len();
        let Snapshot {
            cells, crossings, ..
        } = &snapshot;
        let sizes = cells.gates.iter().chain([
            &cells.v_mv,
            &cells.ca_mm,
            &crossings.up_ms,
            &crossings.down_ms,
        ]);
        for values in sizes {
            if values.len() != expected {
                return Err(ElectrophysiologyError::Snapshot {
                    found: values.len(),
                    expected,
                });
            }
        }
        self.now = snapshot;
        self.n_iterations = 0;
        Ok(())
    }
}

fn check_numbers(tissue: &Tissue, settings: &Settings) -> Result<(), ElectrophysiologyError> {
    let [fibre, sheet, normal] = tissue.conductivity_ms_mm;
    let named = [
        ("the time step in ms", settings.step_ms),
        ("the conductivity along the fibre in mS/mm", fibre),
        ("the conductivity along the sheet in mS/mm", sheet),
        ("the conductivity across the sheet in mS/mm", normal),
        (
            "the surface to volume ratio in 1/mm",
            tissue.surface_to_volume_per_mm,
        ),
        (
            "the membrane capacitance in µF/cm²",
            tissue.capacitance_uf_cm2,
        ),
        (
            "the foot current's time constant in ms",
            settings.foot.tau_ms,
        ),
        (
            "the foot current's amplitude in mV",
            settings.foot.amplitude_mv,
        ),
        ("the foot current's length in ms", settings.foot.length_ms),
    ];
    let cycle = settings
        .cycle_ms
        .map(|cycle| ("the length of a cycle in ms", cycle));
    match named
        .into_iter()
        .chain(cycle)
        .find(|(_, value)| !(*value > 0.0 && value.is_finite()))
    {
        None => Ok(()),
        Some((what, found)) => Err(ElectrophysiologyError::NotPositive { what, found }),
    }
}

fn check_elements(
    mesh: &TetMesh,
    elements: &[usize],
    diffusion: bool,
) -> Result<(), ElectrophysiologyError> {
    for element in elements.iter().copied() {
        let volume = mesh.volume_mm3(element);
        if !(volume > 0.0 && volume.is_finite()) {
            let problem = "has no positive volume: check the mesh";
            return Err(ElectrophysiologyError::Element { element, problem });
        }
        if diffusion
            && mesh
                .frames
                .get(element)
                .is_none_or(|frame| norm(frame.fibre) < 0.5)
        {
            let problem = "conducts, but has no fibre: make fibres first";
            return Err(ElectrophysiologyError::Element { element, problem });
        }
    }
    Ok(())
}

fn check_times(
    nodes: &[u32],
    times: &[f64],
    settings: &Settings,
) -> Result<(), ElectrophysiologyError> {
    for (node, found) in nodes.iter().zip(times) {
        let fits = *found >= 0.0
            && settings
                .cycle_ms
                .is_none_or(|cycle| *found < cycle || found.is_infinite());
        if !fits || (found.is_infinite() && !settings.diffusion) {
            let most = settings.cycle_ms.map_or(String::new(), |cycle| {
                format!(" and below the cycle of {cycle} ms")
            });
            let expected = format!("a time from 0 on{most}, known wherever tissue conducts");
            return Err(ElectrophysiologyError::ActivationTime {
                node: *node as usize,
                found: *found,
                expected,
            });
        }
    }
    if let (true, Some(node)) = (times.iter().all(|t| t.is_infinite()), nodes.first()) {
        let expected = "a finite time at one node at least".to_owned();
        return Err(ElectrophysiologyError::ActivationTime {
            node: *node as usize,
            found: f64::INFINITY,
            expected,
        });
    }
    Ok(())
}
