//! Rates of all states: currents, calcium fluxes, buffers and Land's cross-bridges (Tomek 2019; Margara 2021).

use super::currents::{Currents, Strengths, currents};
use super::gates::{FARADAY, Herg, Relaxation, gate};
use super::state::{CA_I, CA_JSR, CA_NSR, CA_SS, CAMK, K_I, K_SS, N_SLOW, NA_I, NA_SS, State, V};
use super::table::Table;
use super::{CellType, Factors, Outside, Troponin};
use crate::contraction::land2017::Equations;

/// Membrane per volume \[µF/µL\] times 1/F: what a current changes in the cytosol, \[mM/ms\] per A/F.
const PER_VOLUME: [f64; 2] = {
    const RADIUS_CM: f64 = 0.0011;
    const LENGTH_CM: f64 = 0.01;
    // The authors' programs compute with these digits.
    #[allow(clippy::approx_constant)]
    const PI: f64 = 3.14;
    let volume = 1e3 * PI * RADIUS_CM * RADIUS_CM * LENGTH_CM;
    let membrane = 2.0 * (2.0 * PI * RADIUS_CM * RADIUS_CM + 2.0 * PI * RADIUS_CM * LENGTH_CM);
    [
        membrane / (FARADAY * CYTOSOL * volume),
        membrane / (FARADAY * SUBSPACE * volume),
    ]
};
/// Shares of the cell's volume.
const CYTOSOL: f64 = 0.68;
const SUBSPACE: f64 = 0.02;
const NETWORK: f64 = 0.0552;
const JUNCTIONAL: f64 = 0.0048;
/// Calcium that troponin can bind \[mM\].
const TROPONIN_MM: f64 = 0.07;

/// A cell with the constants that its parameters give.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    pub table: Table,
    pub cell_type: CellType,
    pub factors: Factors,
    pub outside: Outside,
    pub strengths: Strengths,
    pub land: Equations,
    pub troponin: Troponin,
    /// Stretch at which the cell is held.
    pub stretch: f64,
}

/// Rates of a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates {
    /// Of potential, concentrations and CaMK, per ms.
    pub slow: [f64; N_SLOW],
    pub gates: Relaxation,
    pub herg: Herg,
    /// Of Land's states \[1/ms\].
    pub land: [f64; 6],
}

/// Bound calcium per change of free calcium at one kind of site, B K/(K + c)².
fn binding(sites_mm: f64, half_mm: f64, free_mm: f64) -> f64 {
    sites_mm * half_mm / (half_mm + free_mm).powi(2)
}

impl Cell {
    /// Rates of `state` under a stimulus \[A/F\] that depolarises where it is negative.
    pub fn rates(&self, state: &State, stimulus: f64) -> Rates {
        let x = &state.0;
        let active = camk_active(x[CAMK], x[CA_SS]);
        let phosphorylated = active / (active + 0.15);
        let currents = currents(&self.strengths, &self.outside, state, phosphorylated);
        let land = self
            .land
            .rates(&state.land(), state.ca_um(), self.stretch, 0.0);
        let (mut gates, herg) = self.table.at(x[V]);
        for (idx, ca_mm) in [(gate::N_CA_SS, x[CA_SS]), (gate::N_CA_I, x[CA_I])] {
            let leaving = state.gates()[gate::J_CA];
            let entering = 500.0 / (500.0 / leaving + (1.0 + 0.002 / ca_mm).powi(4));
            (gates.target[idx], gates.per_ms[idx]) = (entering / leaving, leaving);
        }
        self.release(state, currents.cal_ss, &mut gates);
        Rates {
            slow: self.slow(state, &currents, phosphorylated, land[0], stimulus),
            gates,
            herg,
            land,
        }
    }

    /// Targets and rates of the release, which the L-type current triggers and the store's content scales.
    fn release(&self, state: &State, cal_ss: f64, gates: &mut Relaxation) {
        let store_mm = state.0[CA_JSR];
        let of_type = match self.cell_type {
            CellType::MidMyocardial => 1.7,
            CellType::Endocardial | CellType::Epicardial => 1.0,
        };
        let content = of_type / (1.0 + (1.7 / store_mm).powi(8));
        for (idx, beta_ms) in [(gate::J_REL, 4.75), (gate::J_REL_P, 1.25 * 4.75)] {
            gates.target[idx] = -0.5 * beta_ms * cal_ss * content;
            let tau_ms = (beta_ms / (1.0 + 0.0123 / store_mm)).max(0.001);
            gates.per_ms[idx] = 1.0 / tau_ms;
        }
    }

    /// Rates of potential, concentrations and CaMK.
    ///
    /// - `trpn_per_ms`: rate of Land's CaTRPN
    fn slow(
        &self,
        state: &State,
        currents: &Currents,
        phosphorylated: f64,
        trpn_per_ms: f64,
        stimulus: f64,
    ) -> [f64; N_SLOW] {
        let (x, released) = (&state.0, state.gates());
        let mixed = |plain: f64, p: f64| plain + phosphorylated * (p - plain);
        let [to_i, to_ss] = PER_VOLUME;
        let per_cytosol = SUBSPACE / CYTOSOL;
        let na = (x[NA_SS] - x[NA_I]) / 2.0;
        let k = (x[K_SS] - x[K_I]) / 2.0;
        let ca = (x[CA_SS] - x[CA_I]) / 0.2;
        let release =
            1.5378 * self.factors.j_rel * mixed(released[gate::J_REL], released[gate::J_REL_P]);
        let is_epicardial = self.cell_type == CellType::Epicardial;
        let more = if is_epicardial { 1.3 } else { 1.0 };
        let pumped = mixed(
            x[CA_I] / (x[CA_I] + 0.00092),
            2.75 * x[CA_I] / (x[CA_I] + 0.00075),
        );
        let leak = 0.004_882_5 * x[CA_NSR] / 15.0;
        let uptake = self.factors.j_up * (0.005_425 * more * pumped - leak);
        let refilling = (x[CA_NSR] - x[CA_JSR]) / 60.0;

        let calmodulin = binding(0.05 * more, 0.00238, x[CA_I]);
        let (instantaneous, bound) = match self.troponin {
            Troponin::Instantaneous => (binding(TROPONIN_MM, 0.0005, x[CA_I]), 0.0),
            Troponin::Land => (0.0, TROPONIN_MM * trpn_per_ms),
        };
        let into_cytosol =
            -0.5 * to_i * currents.ca_i - uptake * NETWORK / CYTOSOL + ca * per_cytosol - bound;
        let subspace_sites = binding(0.047, 0.00087, x[CA_SS]) + binding(1.124, 0.0087, x[CA_SS]);
        let into_subspace = -0.5 * to_ss * currents.ca_ss + release * JUNCTIONAL / SUBSPACE - ca;
        let calsequestrin = binding(10.0, 0.8, x[CA_JSR]);

        let mut rates = [0.0; N_SLOW];
        rates[V] = -(currents.total + stimulus);
        rates[NA_I] = -to_i * currents.na_i + na * per_cytosol;
        rates[NA_SS] = -to_ss * currents.na_ss - na;
        rates[K_I] = -to_i * (currents.k_i + stimulus) + k * per_cytosol;
        rates[K_SS] = -to_ss * currents.k_ss - k;
        rates[CA_I] = into_cytosol / (1.0 + calmodulin + instantaneous);
        rates[CA_SS] = into_subspace / (1.0 + subspace_sites);
        rates[CA_NSR] = uptake - refilling * JUNCTIONAL / NETWORK;
        rates[CA_JSR] = (refilling - release) / (1.0 + calsequestrin);
        let active = camk_active(x[CAMK], x[CA_SS]);
        rates[CAMK] = 0.05 * (active - x[CAMK]) * active - 0.00068 * x[CAMK];
        rates
    }
}

/// Active share of CaMK: what calmodulin holds at present, and what is trapped.
fn camk_active(trapped: f64, ca_ss_mm: f64) -> f64 {
    0.05 * (1.0 - trapped) / (1.0 + 0.0015 / ca_ss_mm) + trapped
}
