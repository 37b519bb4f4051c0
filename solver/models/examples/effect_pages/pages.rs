//! Pages of the effects as text: file name and content.

use cardiotwin_models::effects::{
    CATALOGUE, Effect, EffectSetting, InThreeDimensions, Kind, Parameter, PeriodicTraces, Role,
};
use cardiotwin_models::periodic::{FitSubject, PeriodicSettings, find};
use cardiotwin_units::{Ml, Ms};
use std::fmt::Write as _;

const COMMAND: &str = "cargo run --release -p cardiotwin-models --example effect_pages";
const CYCLE: Ms = Ms(800.0);
/// Interval of the samples that are drawn, in those that are computed.
const EVERY: usize = 5;

/// All files of the folder.
pub fn all() -> Vec<(String, String)> {
    let base = traces(&[]);
    let mut files = vec![("README.md".to_owned(), index())];
    for effect in CATALOGUE {
        let on = traces(&[EffectSetting::typical(effect)]);
        files.push((format!("{}.md", effect.name), page(effect)));
        files.push((format!("{}.svg", effect.name), picture(effect, &base, &on)));
    }
    files
}

/// Measured traces of the typical base model with these effects.
fn traces(effects: &[EffectSetting]) -> PeriodicTraces {
    let mut model = FitSubject::new(CYCLE, Ml(110.0))
        .model(&FitSubject::typical(), effects)
        .expect("typical values");
    let settings = PeriodicSettings::with_step(CYCLE, Ms(1.0));
    find(&mut model, CYCLE, &settings, None)
        .expect("a periodic beat")
        .measured(&model)
}

fn kind(effect: &Effect) -> &'static str {
    match effect.kind {
        Kind::Physiology => "physiology",
        Kind::Artefact => "artefact",
    }
}

fn index() -> String {
    let mut text = format!(
        "# Effects beyond the base model\n\n\
         What the [base model](../models.md) lacks, as components that can be added to it alone or together.\n\
         Pictures show a periodic beat of the typical base model without the effect (dashed) and with it (solid).\n\
         Tables have the smallest strength that gets a name, and the standard deviation (sd) of the prior.\n\
         The pages are made from `solver/models/src/effects/` by `{COMMAND}`; a test checks that they are current.\n\n\
         | effect | kind | strength | meaning |\n|---|---|---|---|\n"
    );
    for effect in CATALOGUE {
        let _ = writeln!(
            text,
            "| [{0}]({0}.md) | {1} | `{2}` | {3} |",
            effect.name,
            kind(effect),
            effect.strength().name,
            effect.meaning
        );
    }
    text.push_str(
        "\nAn accepted effect is in the patient's `model.toml` under its name, with its parameters.\n\
         The strength must be given; other absent parameters take their typical value.\n\
         An artefact is refused there: it asks for a correction of the data.\n\n\
         ```toml\n[[effects]]\nname = \"atrial_kick\"\n[effects.parameters]\namplitude_mmHg = 8.0\n```\n\n\
         [CONTRIBUTING.md](../../CONTRIBUTING.md#an-effect) adds an effect.\n",
    );
    text
}

fn number(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-3 {
        format!("{value:e}")
    } else {
        format!("{value}")
    }
}

fn range(p: &Parameter) -> String {
    format!("{} to {}", number(p.range.0), number(p.range.1))
}

fn page(effect: &Effect) -> String {
    let mut text = format!(
        "# {0}\n\n{1}: {2}\n\n```text\n{3}\n```\n\nSource: {4}.\n\n![{0} on and off]({0}.svg)\n\n\
         ## Parameters\n\n| name | unit | meaning | plausible | off | smallest | typical | sd | in a fit |\n\
         |---|---|---|---|---|---|---|---|---|\n",
        effect.name,
        capital(kind(effect)),
        effect.meaning,
        effect.equation,
        effect.source
    );
    for p in effect.parameters {
        let _ = writeln!(
            text,
            "| `{}` | {} | {} | {} | {} | {} | {} | {} | {} |",
            p.name,
            p.unit,
            p.meaning,
            range(p),
            p.off.map_or("none".to_owned(), number),
            if p.role == Role::Strength {
                number(p.smallest)
            } else {
                "–".to_owned()
            },
            number(p.typical),
            number(p.prior_scale),
            match p.role {
                Role::Strength => "strength",
                Role::Shape => "fitted with it",
                Role::Held => "held",
            }
        );
    }
    let _ = write!(
        text,
        "\n## Where it shows\n\nAgainst a refitted base model: {}.\n",
        effect.signature
    );
    if let Some(why) = effect.hidden_because {
        let _ = write!(
            text,
            "\nPressure and volume of one ventricle cannot show it: {why}.\n"
        );
    }
    let confused = effect
        .confused_with
        .iter()
        .map(|name| format!("[{name}]({name}.md)"))
        .collect::<Vec<_>>();
    let confused = if confused.is_empty() {
        "nothing in the catalogue".to_owned()
    } else {
        confused.join(", ")
    };
    let _ = write!(
        text,
        "\n## What it is confused with\n\n{}.\nShown or separated by: {}.\n\nIn 3D: {}\n",
        capital(&confused),
        effect.separated_by.join("; "),
        in_3d(effect)
    );
    if let Some(remedy) = effect.remedy {
        let _ = write!(text, "\n## Remedy\n\n{}.\n", capital(remedy));
    }
    text
}

fn in_3d(effect: &Effect) -> String {
    match effect.in_3d {
        InThreeDimensions::AsItIs => match effect.kind {
            Kind::Physiology => "used unchanged.".to_owned(),
            Kind::Artefact => "used unchanged, between simulated and measured traces.".to_owned(),
        },
        InThreeDimensions::ActivationMap { how } => format!("as an activation map: {how}."),
        InThreeDimensions::PassiveExponents { factor } => {
            format!(
                "all exponents of Guccione's law times `{factor}`; its scale is fitted again in step 0."
            )
        }
        InThreeDimensions::MaterialTerm { how } => format!("as a term of the material: {how}."),
        InThreeDimensions::Cannot { why } => format!("not possible: {why}."),
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

/// One panel: where it stands, its axes, and two curves over each other.
struct Panel<'a> {
    left: f64,
    x: (&'a str, f64, f64),
    y: (&'a str, f64, f64),
}

const WIDTH: f64 = 230.0;
const HEIGHT: f64 = 180.0;
const TOP: f64 = 34.0;

impl Panel<'_> {
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let share = |v: f64, (_, low, high): (&str, f64, f64)| (v - low) / (high - low);
        (
            self.left + WIDTH * share(x, self.x),
            TOP + HEIGHT * (1.0 - share(y, self.y)),
        )
    }

    fn axes(&self, svg: &mut String) {
        let _ = writeln!(
            svg,
            "<rect x=\"{}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"none\" stroke=\"#999\"/>",
            self.left
        );
        for share in [0.0, 0.5, 1.0] {
            let (x, y) = (
                self.x.1 + share * (self.x.2 - self.x.1),
                self.y.1 + share * (self.y.2 - self.y.1),
            );
            let (px, py) = self.place(x, y);
            let _ = writeln!(
                svg,
                "<text x=\"{px:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{x}</text>",
                TOP + HEIGHT + 14.0
            );
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{y}</text>",
                self.left - 4.0,
                py + 4.0
            );
        }
        let middle = self.left + 0.5 * WIDTH;
        let _ = writeln!(
            svg,
            "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            TOP + HEIGHT + 30.0,
            self.x.0
        );
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\">{}</text>",
            self.left,
            TOP - 8.0,
            self.y.0
        );
    }

    fn curve(&self, svg: &mut String, points: impl Iterator<Item = (f64, f64)>, style: &str) {
        let points: Vec<String> = points
            .map(|(x, y)| {
                let (px, py) = self.place(x, y);
                format!("{px:.1},{py:.1}")
            })
            .collect();
        let _ = writeln!(
            svg,
            "<polyline fill=\"none\" {style} points=\"{}\"/>",
            points.join(" ")
        );
    }
}

fn picture(effect: &Effect, base: &PeriodicTraces, on: &PeriodicTraces) -> String {
    let nice = |value: f64, up: bool| {
        let steps = value / 20.0;
        20.0 * if up { steps.ceil() } else { steps.floor() }
    };
    let limits = |a: &[f64], b: &[f64]| {
        let (low, high) = a
            .iter()
            .chain(b)
            .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        (nice(low, false), nice(high, true))
    };
    let pressure = limits(&base.pressure_mmhg, &on.pressure_mmhg);
    let volume = limits(&base.volume_ml, &on.volume_ml);
    let time = ("time in ms", 0.0, base.cycle_length_ms);
    let panels = [
        Panel {
            left: 46.0,
            x: time,
            y: ("pressure in mmHg", pressure.0, pressure.1),
        },
        Panel {
            left: 330.0,
            x: time,
            y: ("volume in mL", volume.0, volume.1),
        },
        Panel {
            left: 614.0,
            x: ("volume in mL", volume.0, volume.1),
            y: ("pressure in mmHg", pressure.0, pressure.1),
        },
    ];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 860 256\" font-family=\"sans-serif\" font-size=\"11\">\n\
         <title>{}: off (dashed) and on (solid)</title>\n<rect width=\"860\" height=\"256\" fill=\"#fff\"/>\n",
        effect.name
    );
    panels.iter().for_each(|panel| panel.axes(&mut svg));
    let styles = [
        "stroke=\"#555\" stroke-dasharray=\"4 3\"",
        "stroke=\"#b3261e\" stroke-width=\"1.5\"",
    ];
    for (traces, style) in [(base, styles[0]), (on, styles[1])] {
        // Around the cycle and back to its first sample.
        let samples = || {
            (0..=traces.volume_ml.len())
                .step_by(EVERY)
                .map(|i| (i as f64, i % traces.volume_ml.len()))
        };
        let at = |i: f64| i * traces.spacing_ms();
        panels[0].curve(
            &mut svg,
            samples().map(|(t, i)| (at(t), traces.pressure_mmhg[i])),
            style,
        );
        panels[1].curve(
            &mut svg,
            samples().map(|(t, i)| (at(t), traces.volume_ml[i])),
            style,
        );
        panels[2].curve(
            &mut svg,
            samples().map(|(_, i)| (traces.volume_ml[i], traces.pressure_mmhg[i])),
            style,
        );
    }
    svg.push_str("</svg>\n");
    svg
}
