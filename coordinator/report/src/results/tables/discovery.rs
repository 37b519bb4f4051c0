//! Tables of one patient's findings of a search for missing effects.

use cardiotwin_schemas::discover::{DiscoverCase, FiniteElementGap, GapAt, Place, RankedEffect};

use crate::results::discovery::finite_element::rms_of;
use crate::results::discovery::words::{plain, probability, strength};
use crate::table::{Cell, Column, Digits, Kind, Table, Tone, cells};

/// The `n` best candidates with their evidence.
#[must_use]
pub fn ranking(case: &DiscoverCase, n: usize) -> Table {
    let columns = [
        Column::new("effect", Kind::Names),
        Column::figures("probability"),
        Column::fixed("delta_bic", 1).label("delta BIC"),
        Column::fixed("evidence", 1),
        Column::words("strength").label("strength (95 %)"),
        Column::words("note"),
        Column::words("in_3d").label("in 3D"),
    ];
    let mut table = Table::new("ranking", "Candidates", columns);
    for effect in case.found.findings.effects.iter().take(n) {
        let (note, tone) = judged(case, effect);
        let mut row = cells![
            effect.name.as_str(),
            probability(effect.probability, 3),
            effect.delta_bic,
            effect.log_evidence,
            strength(effect),
            note,
            effect.in_3d.way.replace('-', " ")
        ];
        for k in [0, 5] {
            row[k].tone = tone;
        }
        row[6].hint = effect.in_3d.how.clone().unwrap_or_default();
        table.rows.push(row);
    }
    table
}

fn judged(case: &DiscoverCase, effect: &RankedEffect) -> (&'static str, Option<Tone>) {
    let is_accepted = case.found.findings.accepted.contains(&effect.name);
    match (is_accepted, case.confirmed == Some(false), effect.artefact) {
        (true, true, true) => (
            "named, not confirmed: correct the data",
            Some(Tone::Doubtful),
        ),
        (true, true, false) => ("named, not confirmed", Some(Tone::Doubtful)),
        (true, false, true) => ("named: correct the data", Some(Tone::Good)),
        (true, false, false) => ("named", Some(Tone::Good)),
        (false, ..) if effect.plausible => ("", None),
        (false, ..) => ("too weak or at the edge of its range", None),
    }
}

/// The gap by signal and phase, before and after the accepted effects, on fitted and on held-out
/// data.
#[must_use]
pub fn gaps(case: &DiscoverCase) -> Table {
    let held_out = |key: &'static str, label: &'static str| Column::fixed(key, 2).label(label);
    let columns = [
        Column::words("gap"),
        Column::fixed("before", 2),
        Column::fixed("after", 2),
        held_out("heldout_before", "held out before"),
        held_out("heldout_after", "held out after"),
    ];
    let mut table = Table::new("gaps", "Gap: rms residual over the noise", columns);
    let found = &case.found.findings;
    for gap in &found.gaps {
        table.rows.push(cells![
            place_of(gap),
            gap.before,
            gap.after,
            gap.heldout_before,
            gap.heldout_after
        ]);
    }
    table.foot.push(cells![
        "all",
        found.gap_before,
        found.gap_after,
        found.gap_heldout_before,
        found.gap_heldout_after
    ]);
    table
}

/// Where a gap is that covers the whole beat.
pub const WHOLE_BEAT: &str = ", whole beat";

fn place_of(gap: &GapAt) -> String {
    match gap.phase.as_str() {
        "beat" => format!("{}{WHOLE_BEAT}", gap.signal),
        phase => format!("{}, {}", gap.signal, plain(phase)),
    }
}

/// The gap of the finite-element ventricle by signal and phase, before and after.
#[must_use]
pub fn finite_element(found: &FiniteElementGap) -> Table {
    let columns = [
        Column::words("gap").label("gap in 3D"),
        Column::fixed("before", 2),
        Column::fixed("after", 2),
    ];
    let title = "Gap of the finite-element ventricle: rms residual over the noise";
    let mut table = Table::new("gaps-in-3d", title, columns);
    for gap in &found.gaps {
        table
            .rows
            .push(cells![place_of(gap), gap.before, gap.after]);
    }
    for (name, before, after) in rms_of(found) {
        let rms = |value: f64| Cell::from(value).digits(Digits::Fixed(1));
        let name = Cell::from(format!("{name} rms"));
        table.foot.push(vec![name, rms(before), rms(after)]);
    }
    table
}

/// The places where the base model and the data disagree.
#[must_use]
pub fn places(case: &DiscoverCase) -> Table {
    let columns = [
        Column::words("where"),
        Column::numbers("size")
            .label("data - model")
            .digits(Digits::Signed(2)),
        Column::words("unit").label(""),
        Column::numbers("z").digits(Digits::Signed(1)),
        Column::figures("share"),
        Column::numbers("z_after").digits(Digits::Signed(1)),
        Column::words("moves"),
    ];
    let title = "Where the base model and the data disagree";
    let mut table = Table::new("places", title, columns);
    let found = &case.found.findings;
    for place in &found.places {
        let same = |p: &&Place| p.signal == place.signal && p.phase == place.phase;
        let after = found.where_after.iter().find(same);
        let after = after.map_or(Cell::from(""), |place| Cell::from(place.z));
        let phase = match place.phase.as_str() {
            "beat" => String::new(),
            phase => format!(", {}", plain(phase)),
        };
        let share = match place.share > 0.0 {
            true => format!("{:.0} %", 100.0 * place.share),
            false => String::new(),
        };
        table.rows.push(cells![
            format!("{}{phase}", plain(&place.signal)),
            place.size,
            place.unit.as_str(),
            place.z,
            share,
            after,
            place.biomarkers.join(", ")
        ]);
    }
    table
}
