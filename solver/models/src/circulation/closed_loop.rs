//! A circulation that closes: from the ventricle through the body, the right heart and the lungs back
//! to a left atrium that contracts.
//!
//! Compartments and paths are those of Regazzoni et al. 2022, J Comput Phys 457:111083: four chambers,
//! and arteries and veins of body and lungs, each a compliance with a resistance and an inertance. The
//! patient's Windkessel takes the place of the body's arteries; the left ventricle is any
//! [`Ventricle`](crate::ventricle::Ventricle).

use super::left_heart::{AORTA, AORTIC_VALVE, LEFT_ATRIUM, MITRAL_VALVE};
use super::{
    Circulation, CirculationError, Compliance, DiodeValve, Direction, Elastance, ElastanceChamber,
    LeftHeart, Resistance, positive,
};
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};

/// Name of the body's arteries behind the root.
pub const SYSTEMIC_ARTERIES: &str = "systemic_arteries";
/// Name of the body's veins.
pub const SYSTEMIC_VEINS: &str = "systemic_veins";
/// Name of the right atrium.
pub const RIGHT_ATRIUM: &str = "right_atrium";
/// Name of the right ventricle.
pub const RIGHT_VENTRICLE: &str = "right_ventricle";
/// Name of the lungs' arteries.
pub const PULMONARY_ARTERIES: &str = "pulmonary_arteries";
/// Name of the lungs' veins.
pub const PULMONARY_VEINS: &str = "pulmonary_veins";
/// Name of the valve between the right chambers.
pub const TRICUSPID_VALVE: &str = "tricuspid_valve";
/// Name of the valve out of the right ventricle.
pub const PULMONARY_VALVE: &str = "pulmonary_valve";

/// Share of the arterial compliance that lies in the aortic root, between valve and characteristic
/// resistance, our value: the root's time constant R1 C is then a few milliseconds.
const ROOT_SHARE: f64 = 0.05;

/// A chamber of the table, with times as shares of the cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableChamber {
    /// Active elastance \[mmHg/mL\].
    pub active_mmhg_per_ml: f64,
    /// Passive elastance \[mmHg/mL\].
    pub passive_mmhg_per_ml: f64,
    /// Volume without pressure \[mL\].
    pub unloaded_ml: f64,
    /// Beginning of the contraction after that of the ventricles, share of the cycle.
    pub after_ventricles: f64,
    /// Duration of the contraction, share of the cycle.
    pub contraction: f64,
    /// Duration of the relaxation, share of the cycle.
    pub relaxation: f64,
}

impl TableChamber {
    /// - `cycle_length`: the cycle of which the times are shares
    fn law(&self, cycle_length: Ms, onset: Ms) -> Elastance {
        let time = |share: f64| Ms(share * cycle_length.0);
        Elastance {
            active_mmhg_per_ml: self.active_mmhg_per_ml,
            passive_mmhg_per_ml: self.passive_mmhg_per_ml,
            unloaded: Ml(self.unloaded_ml),
            begins: onset + time(self.after_ventricles),
            contraction: time(self.contraction),
            relaxation: time(self.relaxation),
        }
    }
}

/// A vessel of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableVessel {
    /// Resistance behind the compliance \[mmHg·s/mL\].
    pub resistance: f64,
    /// Compliance \[mL/mmHg\].
    pub compliance: f64,
    /// Inertance behind the compliance \[mmHg·s²/mL\].
    pub inertance: f64,
}

/// Values that are not measured in a patient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopTable {
    /// Left atrium.
    pub left_atrium: TableChamber,
    /// Right atrium.
    pub right_atrium: TableChamber,
    /// Right ventricle.
    pub right_ventricle: TableChamber,
    /// Arteries of the body. The patient's Windkessel replaces resistance and compliance; the ratio of
    /// both systemic resistances stays.
    pub systemic_arteries: TableVessel,
    /// Veins of the body.
    pub systemic_veins: TableVessel,
    /// Arteries of the lungs.
    pub pulmonary_arteries: TableVessel,
    /// Veins of the lungs.
    pub pulmonary_veins: TableVessel,
    /// Forward resistance of the right heart's valves \[mmHg·s/mL\].
    pub forward: f64,
    /// Backward resistance of the right heart's valves \[mmHg·s/mL\].
    pub backward: f64,
}

impl LoopTable {
    /// The table with another share of the body's resistance between veins and right atrium.
    #[must_use]
    pub fn with_venous_share(mut self, share: f64) -> Self {
        let whole = self.systemic_arteries.resistance + self.systemic_veins.resistance;
        self.systemic_arteries.resistance = (1.0 - share) * whole;
        self.systemic_veins.resistance = share * whole;
        self
    }

    /// The parameters of the public program cardioemulator (`example/data/params_bsln.json`), by the
    /// authors of Regazzoni et al. 2022: an adult at 75 beats a minute. Atria begin to contract a fifth
    /// of the cycle before the ventricles.
    pub const REGAZZONI: Self = Self {
        left_atrium: TableChamber {
            active_mmhg_per_ml: 0.07,
            passive_mmhg_per_ml: 0.18,
            unloaded_ml: 4.0,
            after_ventricles: -0.2,
            contraction: 0.17,
            relaxation: 0.17,
        },
        right_atrium: TableChamber {
            active_mmhg_per_ml: 0.06,
            passive_mmhg_per_ml: 0.07,
            unloaded_ml: 4.0,
            after_ventricles: -0.2,
            contraction: 0.17,
            relaxation: 0.17,
        },
        right_ventricle: TableChamber {
            active_mmhg_per_ml: 0.55,
            passive_mmhg_per_ml: 0.05,
            unloaded_ml: 16.0,
            after_ventricles: 0.0,
            contraction: 0.25,
            relaxation: 0.4,
        },
        systemic_arteries: TableVessel {
            resistance: 0.84,
            compliance: 1.2,
            inertance: 5e-3,
        },
        systemic_veins: TableVessel {
            resistance: 0.32,
            compliance: 60.0,
            inertance: 5e-4,
        },
        pulmonary_arteries: TableVessel {
            resistance: 0.032,
            compliance: 10.0,
            inertance: 5e-4,
        },
        pulmonary_veins: TableVessel {
            resistance: 0.035,
            compliance: 16.0,
            inertance: 5e-4,
        },
        forward: 0.0075,
        backward: 75_006.2,
    };
}

/// A closed circulation around a left ventricle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosedLoop {
    /// Left heart, whose valves and Windkessel stay.
    pub left: LeftHeart,
    /// The left heart at rest: the balance at the start, resistances of the body and times of the
    /// chambers follow from its cycle, filling pressure and peripheral resistance, so that a left heart
    /// with other loads or pacing is in the same body. What `left` has of another peripheral resistance
    /// lies between arteries and veins.
    pub rest: LeftHeart,
    /// Time at which the ventricles begin to contract.
    pub onset: Ms,
    /// Output of a beat at the start, with which the pressures of the start are in balance.
    pub stroke_volume: Ml,
    /// Volume in the body's veins beyond that of the balance, by which the loop is filled.
    pub extra: Ml,
    /// Values that are not measured.
    pub table: LoopTable,
}

/// Pressures of a loop through which blood flows evenly, and the right ventricle's volume.
struct Balance {
    left_atrium: f64,
    pulmonary_veins: f64,
    pulmonary_arteries: f64,
    right_atrium: f64,
    systemic_veins: f64,
    right_ventricle_ml: f64,
    /// Both resistances of the body.
    systemic: (f64, f64),
}

impl ClosedLoop {
    /// A loop with the values of [`LoopTable::REGAZZONI`].
    #[must_use]
    pub fn around(left: LeftHeart, onset: Ms, stroke_volume: Ml) -> Self {
        Self {
            left,
            rest: left,
            onset,
            stroke_volume,
            extra: Ml(0.0),
            table: LoopTable::REGAZZONI,
        }
    }

    fn balance(&self) -> Balance {
        let t = &self.table;
        let flow = self.stroke_volume.0 * 1e3 / self.rest.cycle_length.0;
        let left_atrium = self.rest.left_atrial_pressure.0;
        let pulmonary_veins = left_atrium + t.pulmonary_veins.resistance * flow;
        let pulmonary_arteries = pulmonary_veins + t.pulmonary_arteries.resistance * flow;
        // The right ventricle empties until its largest elastance holds the arteries' pressure, and
        // fills by the output of a beat.
        let right = &t.right_ventricle;
        let emptied = pulmonary_arteries / (right.active_mmhg_per_ml + right.passive_mmhg_per_ml);
        let filled = emptied + self.stroke_volume.0;
        let right_atrium = right.passive_mmhg_per_ml * filled + t.forward * flow;
        // The patient's Windkessel drains to no pressure: the same mean flow, now against the right
        // atrium.
        let peripheral = self.rest.windkessel.peripheral_resistance_mmhg_s_per_ml;
        let total = (peripheral - right_atrium / flow).max(0.5 * peripheral);
        let (arteries, veins) = (t.systemic_arteries.resistance, t.systemic_veins.resistance);
        let of_veins = total * veins / (arteries + veins);
        let change = self.left.windkessel.peripheral_resistance_mmhg_s_per_ml - peripheral;
        Balance {
            left_atrium,
            pulmonary_veins,
            pulmonary_arteries,
            right_atrium,
            systemic_veins: right_atrium + of_veins * flow,
            right_ventricle_ml: right.unloaded_ml + filled,
            systemic: (total - of_veins + change, of_veins),
        }
    }

    /// The cycle of which the chambers' times are shares: with another rate than at rest a contraction
    /// shortens by the square root of the cycle (Bazett 1920, Heart 7:353), and never fills all of it.
    fn cycle_of_times(&self) -> Ms {
        const LONGEST: f64 = 0.9;
        let (rest, now) = (self.rest.cycle_length.0, self.left.cycle_length.0);
        let share = |chamber: &TableChamber| chamber.contraction + chamber.relaxation;
        let t = &self.table;
        let longest = [t.left_atrium, t.right_atrium, t.right_ventricle]
            .iter()
            .map(share)
            .fold(0.0, f64::max);
        let limit = (LONGEST / longest).max(1.0) * now;
        Ms((rest * (now / rest).sqrt()).min(limit))
    }

    /// Assembles the circulation, filled so that pressures are in balance with the output at the
    /// start. The whole blood volume is what compartments and ventricle hold then, and stays.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if a parameter is outside its range.
    pub fn build(&self) -> Result<Circulation, CirculationError> {
        let (t, left) = (&self.table, &self.left);
        positive("closed loop", "stroke volume", self.stroke_volume.0)?;
        positive("closed loop", "cycle length", left.cycle_length.0)?;
        positive(
            "closed loop",
            "cycle length at rest",
            self.rest.cycle_length.0,
        )?;
        let (at, times) = (self.balance(), self.cycle_of_times());
        let mut circuit = Circulation::new();
        let chamber = |name, chamber: &TableChamber, pressure: f64| {
            let law = chamber.law(times, self.onset);
            let start = law.unloaded.0 + pressure / law.at(0.0, left.cycle_length);
            ElastanceChamber::new(name, law, left.cycle_length, Ml(start)).map(Box::new)
        };
        let atrium = chamber(LEFT_ATRIUM, &t.left_atrium, at.left_atrium)?;
        let atrium = circuit.add_compartment(atrium);

        let load = &left.windkessel;
        let (characteristic, whole) = (
            load.characteristic_resistance_mmhg_s_per_ml,
            load.compliance_ml_per_mmhg,
        );
        let start = left.start_pressure();
        let has_root = characteristic > 0.0;
        let of_root = if has_root { ROOT_SHARE } else { 1.0 };
        let aorta = Compliance::new(AORTA, of_root * whole, start)?;
        let aorta = circuit.add_compartment(Box::new(aorta));

        let mitral = DiodeValve::new(MITRAL_VALVE, left.mitral_forward, left.mitral_backward)?;
        circuit.connect(Box::new(mitral), atrium, Direction::IntoVentricle);
        let aortic = DiodeValve::new(AORTIC_VALVE, left.aortic_forward, left.aortic_backward)?;
        circuit.connect(Box::new(aortic), aorta, Direction::OutOfVentricle);

        let arteries = if has_root {
            let distal = Compliance::new(SYSTEMIC_ARTERIES, (1.0 - of_root) * whole, start)?;
            let distal = circuit.add_compartment(Box::new(distal));
            let root = Resistance::new("aortic_root", MmhgSPerMl(characteristic))?;
            circuit.link(Box::new(root), aorta, distal);
            distal
        } else {
            aorta
        };
        let veins_mmhg = at.systemic_veins + self.extra.0 / t.systemic_veins.compliance;
        let veins = Compliance::new(
            SYSTEMIC_VEINS,
            t.systemic_veins.compliance,
            Mmhg(veins_mmhg),
        )?;
        let veins = circuit.add_compartment(Box::new(veins));
        let right_atrium = chamber(RIGHT_ATRIUM, &t.right_atrium, at.right_atrium)?;
        let right_atrium = circuit.add_compartment(right_atrium);
        let law = t.right_ventricle.law(times, self.onset);
        let start = Ml(at.right_ventricle_ml);
        let right = ElastanceChamber::new(RIGHT_VENTRICLE, law, left.cycle_length, start)?;
        let right = circuit.add_compartment(Box::new(right));
        let lung = |name, vessel: &TableVessel, pressure: f64| {
            Compliance::new(name, vessel.compliance, Mmhg(pressure)).map(Box::new)
        };
        let (out, back) = (&t.pulmonary_arteries, &t.pulmonary_veins);
        let lung_arteries = lung(PULMONARY_ARTERIES, out, at.pulmonary_arteries)?;
        let lung_arteries = circuit.add_compartment(lung_arteries);
        let lung_veins = lung(PULMONARY_VEINS, back, at.pulmonary_veins)?;
        let lung_veins = circuit.add_compartment(lung_veins);

        let (of_arteries, of_veins) = at.systemic;
        for (name, resistance, inertance, from, to) in [
            (
                "periphery",
                of_arteries,
                t.systemic_arteries.inertance,
                arteries,
                veins,
            ),
            (
                "venous_return",
                of_veins,
                t.systemic_veins.inertance,
                veins,
                right_atrium,
            ),
            (
                "lungs",
                out.resistance,
                out.inertance,
                lung_arteries,
                lung_veins,
            ),
            (
                "pulmonary_return",
                back.resistance,
                back.inertance,
                lung_veins,
                atrium,
            ),
        ] {
            let vessel = Resistance::new(name, MmhgSPerMl(resistance))?;
            let path = circuit.link(Box::new(vessel), from, to);
            circuit.set_inertance(path, inertance);
        }
        for (name, from, to) in [
            (TRICUSPID_VALVE, right_atrium, right),
            (PULMONARY_VALVE, right, lung_arteries),
        ] {
            let valve = DiodeValve::new(name, MmhgSPerMl(t.forward), MmhgSPerMl(t.backward))?;
            circuit.link(Box::new(valve), from, to);
        }
        Ok(circuit)
    }
}

#[cfg(test)]
#[path = "closed_loop_tests.rs"]
mod tests;
