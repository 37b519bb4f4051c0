//! Arguments that the programs with and without MPI share.

use cardiotwin_schemas::finite_element::FiniteElementSettings;
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::kernels::{Element, VentricleBench};

/// A beat of the generated 3D ventricle.
#[derive(Debug, Clone, Copy, Args)]
pub struct BeatArgs {
    /// Linear elements with nodal volume change, or with a plain penalty (the paper's)
    #[arg(long, value_enum, default_value_t = Elements::Linear)]
    element: Elements,
    /// Length of the beat; the default is whole
    #[arg(long, value_name = "MS", default_value_t = 659.0)]
    cycle: f64,
    /// Time step
    #[arg(long, value_name = "MS", default_value_t = 1.0)]
    step: f64,
    /// Longest controlled time step; 0: all steps have one length
    #[arg(long, value_name = "MS", default_value_t = FiniteElementSettings::default().longest_step_ms)]
    longest: f64,
    /// Relative tolerance of Newton's method
    #[arg(long, default_value_t = 1e-4)]
    tolerance: f64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Elements {
    Linear,
    Pointwise,
}

impl BeatArgs {
    /// The beat on a mesh of about `nodes` nodes.
    ///
    /// # Errors
    /// Names the argument that is not a positive number.
    pub fn bench(&self, nodes: usize) -> anyhow::Result<VentricleBench> {
        let positive = [
            ("--cycle", self.cycle),
            ("--step", self.step),
            ("--tolerance", self.tolerance),
        ];
        for (name, value) in positive {
            anyhow::ensure!(
                value > 0.0 && value.is_finite(),
                "{name} {value}: expected a positive number"
            );
        }
        let element = match self.element {
            Elements::Linear => Element::Linear,
            Elements::Pointwise => Element::Pointwise,
        };
        let FiniteElementSettings {
            diastolic_step_ms,
            step_tolerance,
            ..
        } = FiniteElementSettings::default();
        Ok(VentricleBench {
            nodes,
            element,
            cycle_ms: self.cycle,
            step_ms: self.step,
            diastolic_step_ms,
            longest_step_ms: self.longest,
            step_tolerance,
            tolerance: self.tolerance,
        })
    }
}

/// Form of the printed figures.
#[derive(Debug, Clone, Copy, Args)]
pub struct Output {
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

impl Output {
    /// Prints each figure on a line with its name, or all as JSON.
    ///
    /// # Errors
    /// If the figures cannot be represented in JSON.
    pub fn print(self, figures: &impl Serialize) -> anyhow::Result<()> {
        let values = serde_json::to_value(figures)?;
        self.print_as(&values, |values| {
            let entries = values.as_object().into_iter().flatten();
            entries
                .map(|(name, value)| format!("{name:<40}{value}\n"))
                .collect()
        })
    }

    /// Prints `text` of the figures, or the figures as JSON.
    ///
    /// # Errors
    /// If the figures cannot be represented in JSON.
    pub fn print_as<T: Serialize>(
        self,
        figures: &T,
        text: impl FnOnce(&T) -> String,
    ) -> anyhow::Result<()> {
        if self.json {
            println!("{}", serde_json::to_string(figures)?);
        } else {
            print!("{}", text(figures));
        }
        Ok(())
    }
}
