//! Pictures of the wall, cut open: triangles painted from far to near, coloured in bands, and
//! shaded by the light.

use std::collections::HashMap;
use std::fmt::Write as _;

use cardiotwin_schemas::heart::{HeartState, HeartSurface};
use maud::{Markup, PreEscaped, html};

use super::camera::{Camera, Vec3, cross, dot, sub, unit};
use super::palette::{BANDS, Map, SHADES};
use crate::html::format::fixed;

/// Units of the picture per millimetre. Positions are rounded to whole units.
const UNITS_PER_MM: f64 = 6.0;
/// Margin around the heart, units.
const MARGIN: f64 = 8.0;
/// Room for the scale below the heart, units.
const BELOW: f64 = 30.0;
/// Length of the scale \[mm\].
const SCALE_MM: f64 = 20.0;
/// Direction from which the light comes: right, up, towards the viewer.
const LIGHT: Vec3 = [-0.4, 0.45, 0.8];
/// Share of the corners whose value may lie beyond each end of the colours.
const BEYOND: f64 = 0.02;

/// A colour map and the interval of values that its colours cover.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Colours {
    map: Map,
    lo: f64,
    hi: f64,
}

impl Colours {
    fn of(map: Map, heart: &HeartSurface) -> Option<Self> {
        // The interval covers the values at end-systole. At end-diastole, stress is 0 and stretch 1
        // everywhere, for which the end colours are sufficient.
        let mut all: Vec<f64> = values(map, heart.states.last()?)
            .iter()
            .flatten()
            .copied()
            .collect();
        all.sort_by(f64::total_cmp);
        let at = |share: f64| {
            all.get((share * (all.len().saturating_sub(1)) as f64) as usize)
                .copied()
        };
        let (low, high) = (at(BEYOND)?, at(1.0 - BEYOND)?);
        let (lo, hi) = match map {
            Map::Stretch => ((low / 0.05).floor() * 0.05, (high / 0.05).ceil() * 0.05),
            _ => (0.0, (high.max(1.0) / 10.0).ceil() * 10.0),
        };
        Some(Self {
            map,
            lo,
            hi: if hi > lo { hi } else { lo + 0.05 },
        })
    }

    /// Position of a value in bands; values beyond the interval get the end bands.
    fn place(&self, value: f64) -> f64 {
        ((value - self.lo) / (self.hi - self.lo) * BANDS as f64).clamp(0.0, BANDS as f64)
    }
}

fn values(map: Map, state: &HeartState) -> &[Option<f64>] {
    if map == Map::Stretch {
        &state.lambda
    } else {
        &state.sa_kpa
    }
}

/// A polygon of one colour.
struct Painted {
    near: f64,
    class: String,
    outline: Vec<(f64, f64)>,
}

/// All pictures of a surface in the same view and scale.
struct Scene<'a> {
    heart: &'a HeartSurface,
    camera: Camera,
    /// Left end, upper end, width and height, units.
    frame: [f64; 4],
}

impl<'a> Scene<'a> {
    fn of(heart: &'a HeartSurface) -> Self {
        let camera = Camera::of(heart.long_axis, heart.towards_viewer);
        let mut ends = [
            f64::INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NEG_INFINITY,
        ];
        for point in heart.states.iter().flat_map(|state| &state.points_mm) {
            let [x, y, _] = camera.see(*point).map(|x| x * UNITS_PER_MM);
            ends = [
                ends[0].min(x),
                ends[1].min(-y),
                ends[2].max(x),
                ends[3].max(-y),
            ];
        }
        let [x0, y0, x1, y1] = ends;
        let frame = [
            x0 - MARGIN,
            y0 - MARGIN,
            x1 - x0 + 2.0 * MARGIN,
            y1 - y0 + 2.0 * MARGIN + BELOW,
        ];
        Self {
            heart,
            camera,
            frame,
        }
    }

    /// Positions of a state's corners in the picture, units, with their nearness to the viewer.
    fn places(&self, state: &HeartState) -> Vec<Vec3> {
        let [x0, y0, ..] = self.frame;
        let place = |point: &Vec3| {
            let [x, y, z] = self.camera.see(*point).map(|x| x * UNITS_PER_MM);
            [x - x0, -y - y0, z]
        };
        state.points_mm.iter().map(place).collect()
    }

    fn picture(&self, k: usize, colours: &Colours, alt: &str) -> Markup {
        let state = &self.heart.states[k];
        let places = self.places(state);
        let [_, _, width, height] = self.frame.map(f64::round);
        let outline = self.outline();
        html! {
            svg.heart viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(alt) {
                title { (alt) }
                (PreEscaped(self.painted(state, &places, colours)))
                path.edge d=(loops(&outline, &places)) {}
                @if k > 0 { path.ghost d=(loops(&outline, &self.places(&self.heart.states[0]))) {} }
                path.scale d={ "M8 " (height - 14.0) "v5h" (SCALE_MM * UNITS_PER_MM) "v-5" } {}
                text x=(16.0 + SCALE_MM * UNITS_PER_MM) y=(height - 6.0) { (SCALE_MM) " mm" }
            }
        }
    }

    /// Paths of the visible triangles from far to near.
    fn painted(&self, state: &HeartState, places: &[Vec3], colours: &Colours) -> String {
        let light = unit(LIGHT);
        let mut polygons: Vec<Painted> = Vec::new();
        for part in &self.heart.parts {
            let normals = self.normals(state, &part.triangles);
            for triangle in &part.triangles {
                let corners = triangle.map(|c| places[c as usize]);
                // The picture's y axis points down, so that triangles facing the viewer turn the
                // other way round.
                let turn = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]))[2];
                if turn >= 0.0 {
                    continue;
                }
                let normal = triangle.iter().fold([0.0; 3], |sum: Vec3, c| {
                    let n = normals[c];
                    std::array::from_fn(|i| sum[i] + n[i])
                });
                let bright = dot(self.camera.see(unit(normal)), light).max(0.0);
                let shade = (bright * (SHADES - 1) as f64).round() as usize;
                let near = corners.iter().map(|c| c[2]).sum::<f64>() / 3.0;
                let of = |c: u32| values(colours.map, state)[c as usize].filter(|_| part.contracts);
                let [Some(a), Some(b), Some(c)] = triangle.map(of) else {
                    let outline = corners.iter().map(|c| (c[0], c[1])).collect();
                    polygons.push(Painted {
                        near,
                        class: Map::Passive.class(0, shade),
                        outline,
                    });
                    continue;
                };
                let at = [a, b, c].map(|value| colours.place(value));
                let all: Vec<Vec3> = (0..3)
                    .map(|i| [corners[i][0], corners[i][1], at[i]])
                    .collect();
                for (band, outline) in banded(&all) {
                    polygons.push(Painted {
                        near,
                        class: colours.map.class(band, shade),
                        outline,
                    });
                }
            }
        }
        polygons.sort_by(|a, b| a.near.total_cmp(&b.near));
        let mut text = String::new();
        let mut open: Option<&str> = None;
        for Painted { class, outline, .. } in &polygons {
            let Some(data) = closed(outline) else {
                continue;
            };
            if open != Some(class) {
                text.push_str(if open.is_some() {
                    "\"/><path class="
                } else {
                    "<path class="
                });
                let _ = write!(text, "{class} d=\"");
                open = Some(class);
            }
            text.push_str(&data);
        }
        if open.is_some() {
            text.push_str("\"/>");
        }
        text
    }

    /// Mean normals of a part at its corners, so that its facets are shaded smoothly.
    fn normals(&self, state: &HeartState, triangles: &[[u32; 3]]) -> HashMap<u32, Vec3> {
        let mut sums: HashMap<u32, Vec3> = HashMap::new();
        for triangle in triangles {
            let [a, b, c] = triangle.map(|c| state.points_mm[c as usize]);
            let area = cross(sub(b, a), sub(c, a));
            for corner in triangle {
                let sum = sums.entry(*corner).or_default();
                *sum = std::array::from_fn(|i| sum[i] + area[i]);
            }
        }
        sums.into_iter()
            .map(|(corner, sum)| (corner, unit(sum)))
            .collect()
    }

    /// Lines around the cut, each a closed loop of corners.
    fn outline(&self) -> Vec<Vec<u32>> {
        let mut next: HashMap<(u32, u32), ()> = HashMap::new();
        let cut = self.heart.parts.iter().filter(|part| part.surface == "cut");
        for [a, b, c] in cut.flat_map(|part| &part.triangles) {
            for edge in [(*a, *b), (*b, *c), (*c, *a)] {
                next.insert(edge, ());
            }
        }
        let mut follows: HashMap<u32, u32> = next
            .keys()
            .filter(|(a, b)| !next.contains_key(&(*b, *a)))
            .copied()
            .collect();
        let mut found = Vec::new();
        while let Some(first) = follows.keys().min().copied() {
            let mut line = vec![first];
            let mut now = first;
            while let Some(then) = follows.remove(&now) {
                line.push(then);
                now = then;
            }
            found.push(line);
        }
        found
    }
}

/// Parts of a triangle in each band. A corner consists of x, y and its position in bands.
fn banded(triangle: &[Vec3]) -> Vec<(usize, Vec<(f64, f64)>)> {
    let lowest = triangle.iter().map(|c| c[2]).fold(f64::INFINITY, f64::min);
    let highest = triangle.iter().map(|c| c[2]).fold(0.0, f64::max);
    let first = (lowest.floor() as usize).min(BANDS - 1);
    let last = ((highest.ceil() as usize).max(first + 1) - 1).min(BANDS - 1);
    (first..=last)
        .map(|band| {
            let above = clipped(triangle, |c| c[2] - band as f64);
            let inside = clipped(&above, |c| (band + 1) as f64 - c[2]);
            (band, inside.iter().map(|c| (c[0], c[1])).collect())
        })
        .filter(|(_, outline): &(usize, Vec<(f64, f64)>)| outline.len() > 2)
        .collect()
}

/// The part of a convex polygon where `side` is not negative.
fn clipped(polygon: &[Vec3], side: impl Fn(&Vec3) -> f64) -> Vec<Vec3> {
    let mut left = Vec::with_capacity(polygon.len() + 1);
    for k in 0..polygon.len() {
        let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (at, then) = (side(&a), side(&b));
        if at >= 0.0 {
            left.push(a);
        }
        if (at >= 0.0) != (then >= 0.0) {
            let share = at / (at - then);
            left.push(std::array::from_fn(|i| a[i] + share * (b[i] - a[i])));
        }
    }
    left
}

/// Path data of a closed outline in whole units; `None` if it has no area after rounding.
fn closed(outline: &[(f64, f64)]) -> Option<String> {
    let mut places: Vec<(i64, i64)> = outline
        .iter()
        .map(|(x, y)| (x.round() as i64, y.round() as i64))
        .collect();
    places.dedup();
    if places.len() > 1 && places.first() == places.last() {
        places.pop();
    }
    if places.len() < 3 {
        return None;
    }
    let mut data = format!("M{} {}l", places[0].0, places[0].1);
    for (k, pair) in places.windows(2).enumerate() {
        for (i, step) in [pair[1].0 - pair[0].0, pair[1].1 - pair[0].1]
            .into_iter()
            .enumerate()
        {
            // A minus sign separates numbers as well as a space does.
            let first = k == 0 && i == 0;
            let _ = if first || step < 0 {
                write!(data, "{step}")
            } else {
                write!(data, " {step}")
            };
        }
    }
    data.push('z');
    Some(data)
}

fn loops(lines: &[Vec<u32>], places: &[Vec3]) -> String {
    let mut data = String::new();
    for line in lines {
        for (k, corner) in line.iter().enumerate() {
            let [x, y, _] = places[*corner as usize];
            let _ = write!(
                data,
                "{}{} {}",
                if k == 0 { "M" } else { "L" },
                x.round(),
                y.round()
            );
        }
    }
    data
}

fn colour_bar(colours: &Colours, name: &str, unit: &str, decimals: usize) -> Markup {
    html! {
        span.colourbar {
            (name) " " (fixed(Some(colours.lo), decimals))
            svg viewBox={ "0 0 " (BANDS) " 1" } preserveAspectRatio="none" role="img" aria-label={ "colours of " (name) } {
                @for band in 0..BANDS { rect x=(band) y="0" width="1.02" height="1" fill=(colours.map.hex(band)) {} }
            }
            (fixed(Some(colours.hi), decimals)) " " (unit)
        }
    }
}

/// Pictures of end-diastole and end-systole, coloured by active stress and by stretch.
///
/// - `whose`: description of the simulation
pub fn pictures(heart: &HeartSurface, patient: &str, whose: &str) -> Markup {
    let scene = Scene::of(heart);
    let rows = [
        (Map::Stress, "active stress", "kPa", 0),
        (
            Map::Stretch,
            "fibre stretch",
            "and above; 1 at end-diastole",
            2,
        ),
    ];
    let rows: Vec<_> = rows
        .into_iter()
        .filter_map(|row| Some((Colours::of(row.0, heart)?, row)))
        .collect();
    let shown: usize = heart.parts.iter().map(|part| part.triangles.len()).sum();
    html! {
        p.quiet {
            "The wall of " (whose) ", cut open along its long axis" @if has_septum(heart) { " through the middle of the septum (left)" }
            "; the same tissue, view and scale at both instants. Dashed: the cut at end-diastole. Grey: the aortic root, which does not contract."
            @if (shown as u64) < heart.triangles_before { " Drawn with " (shown) " of " (heart.triangles_before) " triangles." }
        }
        p.legend { @for (colours, (_, name, unit, decimals)) in &rows { (colour_bar(colours, name, unit, *decimals)) } }
        div.hearts {
            @for (colours, (_, name, ..)) in &rows {
                @for (k, state) in heart.states.iter().enumerate() {
                    @let title = state.name.replacen('e', "E", 1);
                    figure {
                        figcaption {
                            b { (title) } ", " (name)
                            span.quiet { ": " (fixed(Some(state.time_ms), 0)) " ms, " (fixed(Some(state.volume_ml), 0)) " mL, " (fixed(Some(state.pressure_mmhg), 0)) " mmHg" }
                        }
                        (scene.picture(k, colours, &format!("{name} of {patient} at {}", state.name)))
                    }
                }
            }
        }
    }
}

fn has_septum(heart: &HeartSurface) -> bool {
    heart.parts.iter().any(|part| part.surface == "septum")
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::heart::HeartPart;

    use super::*;

    /// A cube cut open: its face towards the viewer is the cut.
    fn cube() -> HeartSurface {
        let points: Vec<Vec3> = (0..8)
            .map(|k| [f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)].map(|x| 40.0 * x))
            .collect();
        // The face y = 0 is towards the viewer.
        let front = vec![[0, 1, 5], [0, 5, 4]];
        let rest = vec![
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
            [4, 5, 7],
            [4, 7, 6],
            [0, 2, 3],
            [0, 3, 1],
        ];
        let lambda: Vec<Option<f64>> = points
            .iter()
            .map(|p| Some(0.8 + 0.2 * p[2] / 40.0))
            .collect();
        let state = |name: &str, sa: f64, lambda: Vec<Option<f64>>| HeartState {
            name: name.into(),
            time_ms: 0.0,
            volume_ml: 100.0,
            pressure_mmhg: 8.0,
            points_mm: points.clone(),
            sa_kpa: vec![Some(sa); 8],
            lambda,
        };
        HeartSurface {
            schema_version: cardiotwin_schemas::formats::HEART.version,
            long_axis: [0.0, 0.0, 1.0],
            towards_viewer: [0.0, -1.0, 0.0],
            triangles_before: 12,
            parts: vec![
                HeartPart {
                    surface: "cut".into(),
                    contracts: true,
                    triangles: front,
                },
                HeartPart {
                    surface: "rim".into(),
                    contracts: false,
                    triangles: rest,
                },
            ],
            states: vec![
                state("end-diastole", 0.0, vec![Some(1.0); 8]),
                state("end-systole", 37.0, lambda),
            ],
            beat: None,
        }
    }

    #[test]
    fn what_faces_away_is_not_painted_and_bands_follow_the_values() {
        let heart = cube();
        let scene = Scene::of(&heart);
        let stretch = Colours::of(Map::Stretch, &heart).unwrap();
        assert!((stretch.lo - 0.8).abs() < 1e-9 && (stretch.hi - 1.0).abs() < 1e-9);
        let count = |state: usize, colours: &Colours| {
            let state = &heart.states[state];
            let text = scene.painted(state, &scene.places(state), colours);
            assert_eq!(
                text.matches('"').count(),
                2 * text.matches("<path").count(),
                "{text}"
            );
            (
                text.matches("class=l").count(),
                text.matches("class=s").count(),
                text.matches('z').count(),
            )
        };
        // Front, top and right side are visible: six triangles, two of them in bands.
        let (l, s, z) = count(0, &stretch);
        assert_eq!((s, z), (0, 6));
        assert!(l >= 1);
        let (_, _, z) = count(1, &stretch);
        assert!(z >= 4 + 2 * BANDS - 2, "{z}");
        let stress = Colours::of(Map::Stress, &heart).unwrap();
        assert_eq!((stress.lo, stress.hi), (0.0, 40.0));
        assert!(count(1, &stress).1 >= 1);
    }

    #[test]
    fn bands_cover_a_triangle_exactly() {
        let triangle = [[0.0, 0.0, 0.3], [10.0, 0.0, 7.7], [0.0, 10.0, 12.0]];
        let area = |p: &[(f64, f64)]| -> f64 {
            (0..p.len())
                .map(|k| p[k].0 * p[(k + 1) % p.len()].1 - p[(k + 1) % p.len()].0 * p[k].1)
                .sum::<f64>()
                / 2.0
        };
        let bands = banded(&triangle);
        assert_eq!(
            bands.iter().map(|b| b.0).collect::<Vec<_>>(),
            (0..BANDS).collect::<Vec<_>>()
        );
        assert!((bands.iter().map(|b| area(&b.1)).sum::<f64>() - 50.0).abs() < 1e-9);
        for value in [0.0, 5.0, 12.0] {
            let even = banded(&triangle.map(|[x, y, _]| [x, y, value]));
            assert_eq!(even.len(), 1, "{value}");
            assert!((area(&even[0].1) - 50.0).abs() < 1e-9);
        }
    }

    #[test]
    fn pictures_share_their_frame_and_say_what_they_show() {
        let html = pictures(&cube(), "P<1>", "step 1, iteration 2").into_string();
        let frames: Vec<&str> = html
            .split("<svg class=\"heart\" viewBox=\"")
            .skip(1)
            .map(|s| s.split('"').next().unwrap())
            .collect();
        assert_eq!(frames.len(), 4);
        assert!(frames.iter().all(|f| f == &frames[0]));
        assert!(
            html.contains("active stress of P&lt;1&gt; at end-systole")
                && html.contains("End-systole")
        );
        assert_eq!(html.matches("class=\"ghost\"").count(), 2);
        // The outline of the cut is one closed loop of four corners.
        let scene = cube();
        let outline = Scene::of(&scene).outline();
        assert_eq!(outline.len(), 1);
        assert_eq!(
            (outline[0].len(), outline[0].first()),
            (5, outline[0].last())
        );
    }
}
