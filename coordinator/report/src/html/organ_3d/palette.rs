//! Colours of the pictures: bands of a quantity in several shades, as classes of a style sheet.

use std::fmt::Write as _;

/// Number of bands of a quantity.
pub const BANDS: usize = 12;
/// Number of shades of a band, from dark to light.
pub const SHADES: usize = 6;
/// Brightness of the darkest shade relative to the full colour.
const DARKEST: f64 = 0.58;

/// Assignment of colours to the values of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Map {
    /// Active stress: dark violet to light yellow (after inferno of matplotlib, by S. van der Walt and N. Smith, CC0).
    Stress,
    /// Stretch: violet over green to yellow (after viridis of the same authors).
    Stretch,
    /// Tissue that does not contract.
    Passive,
}

const STRESS: [[f64; 3]; 7] = [
    [40.0, 11.0, 84.0],
    [101.0, 21.0, 110.0],
    [159.0, 42.0, 99.0],
    [212.0, 72.0, 66.0],
    [245.0, 125.0, 21.0],
    [250.0, 193.0, 39.0],
    [252.0, 255.0, 164.0],
];
const STRETCH: [[f64; 3]; 7] = [
    [68.0, 1.0, 84.0],
    [68.0, 57.0, 131.0],
    [49.0, 104.0, 142.0],
    [33.0, 145.0, 140.0],
    [53.0, 183.0, 121.0],
    [144.0, 215.0, 67.0],
    [253.0, 231.0, 37.0],
];
const PASSIVE: [f64; 3] = [176.0, 184.0, 192.0];

impl Map {
    /// First letter of the map's classes.
    fn letter(self) -> char {
        match self {
            Self::Stress => 's',
            Self::Stretch => 'l',
            Self::Passive => 'p',
        }
    }

    /// Colour of a band in full light.
    fn colour(self, band: usize) -> [f64; 3] {
        let stops = match self {
            Self::Stress => &STRESS,
            Self::Stretch => &STRETCH,
            Self::Passive => return PASSIVE,
        };
        let at = band as f64 / (BANDS - 1) as f64 * (stops.len() - 1) as f64;
        let k = (at as usize).min(stops.len() - 2);
        std::array::from_fn(|i| stops[k][i] + (at - k as f64) * (stops[k + 1][i] - stops[k][i]))
    }

    /// Class of a band in a shade: letter, band (hexadecimal), shade.
    pub fn class(self, band: usize, shade: usize) -> String {
        format!("{}{:x}{shade}", self.letter(), band)
    }

    /// Colour of a band in the colour bar, which is not shaded.
    pub fn hex(self, band: usize) -> String {
        hex(self.colour(band))
    }
}

fn hex(colour: [f64; 3]) -> String {
    let [r, g, b] = colour.map(|x| x.round().clamp(0.0, 255.0) as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Rules of all classes. Strokes in the colour of the area hide the seams between neighbours.
pub fn css() -> String {
    let mut text = String::from(
        "svg.heart{display:block;width:100%;height:auto;max-height:30rem;stroke-width:1.3;stroke-linejoin:round}\n\
         .heart .edge{fill:none;stroke:var(--fg);stroke-width:1.1;opacity:.75}.heart .ghost{fill:none;stroke:var(--quiet);stroke-width:1.4;stroke-dasharray:5 4}\n\
         .heart text{fill:var(--fg);stroke:none;font:19px system-ui,-apple-system,\"Segoe UI\",Roboto,\"Noto Sans\",\"DejaVu Sans\",sans-serif}.heart .scale{stroke:var(--fg);stroke-width:1.5;fill:none}\n\
         .hearts{display:grid;grid-template-columns:repeat(4,minmax(0,1fr));gap:.6rem 1.2rem;align-items:end;max-width:100rem}\n\
         @media (max-width:72rem){.hearts{grid-template-columns:repeat(2,minmax(0,1fr))}}\
         @media screen and (max-width:46rem){.heart text{font-size:30px}.colourbar{white-space:nowrap;font-size:.8rem;margin-right:0}.colourbar svg{width:6rem;flex:0 1 6rem}}\
         @media print{.hearts{grid-template-columns:repeat(4,minmax(0,1fr))}.hearts *{print-color-adjust:exact;-webkit-print-color-adjust:exact}}\n\
         .colourbar{display:inline-flex;align-items:center;gap:.5rem;margin-right:1.6rem}.colourbar svg{width:11rem;height:.8rem;flex:none}\n",
    );
    for map in [Map::Stress, Map::Stretch, Map::Passive] {
        let bands = if map == Map::Passive { 1 } else { BANDS };
        for band in 0..bands {
            for shade in 0..SHADES {
                let light = DARKEST + (1.0 - DARKEST) * shade as f64 / (SHADES - 1) as f64;
                let colour = hex(map.colour(band).map(|x| x * light));
                let _ = write!(
                    text,
                    ".{}{{fill:{colour};stroke:{colour}}}",
                    map.class(band, shade)
                );
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_class_has_one_rule_and_maps_run_from_dark_to_light() {
        let css = css();
        for map in [Map::Stress, Map::Stretch] {
            for band in 0..BANDS {
                for shade in 0..SHADES {
                    assert_eq!(
                        css.matches(&format!(".{}{{", map.class(band, shade)))
                            .count(),
                        1
                    );
                }
            }
            let light = |band| {
                let [r, g, b] = map.colour(band);
                0.299 * r + 0.587 * g + 0.114 * b
            };
            assert!(
                (1..BANDS).all(|band| light(band) > light(band - 1)),
                "{map:?}"
            );
        }
    }

    #[test]
    fn the_script_has_the_colours_of_the_pictures() {
        let script = include_str!("../heart.js");
        for stops in [STRESS, STRETCH] {
            let line: Vec<String> = stops
                .iter()
                .map(|[r, g, b]| format!("[{r}, {g}, {b}]"))
                .collect();
            assert!(script.contains(&line.join(", ")), "{line:?}");
        }
        let [r, g, b] = PASSIVE;
        assert!(script.contains(&format!("PASSIVE = [{r}, {g}, {b}]")));
        assert!(script.contains(&format!("BANDS = {BANDS}")));
    }
}
