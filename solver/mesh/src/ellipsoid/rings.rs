//! Triangulation common to all layers of the wall: rings around the axis, from the apex to the rim.

use super::shape::Shape;
use crate::vec3::distance;
use std::f64::consts::TAU;

/// Ratio of the distance between rings to the distance between nodes on a ring, for equilateral
/// triangles.
const RING_SPACING: f64 = 0.866_025_403_784_438_6;
/// Ratio of a layer's thickness to the distance between nodes on a ring. Of the ratios tried, this
/// one gave the best mean ratio of elements (`cargo run --release --manifest-path dev/Cargo.toml --example
/// mesh-figures`).
const LAYER_SPACING: f64 = 0.8;
/// Smallest number of layers, because bending needs two elements through the wall.
const MIN_LAYERS: usize = 2;

/// A line of nodes through the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column {
    /// Height as in [`Shape::polar`].
    pub height: f64,
    /// Angle around the axis \[radians\].
    pub angle: f64,
}

/// Columns and the triangles between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Rings {
    pub columns: Vec<Column>,
    /// Corners of the triangles, counter-clockwise as seen from outside the heart.
    pub triangles: Vec<[u32; 3]>,
    /// Whether each triangle lies above the contracting wall.
    pub in_ring: Vec<bool>,
}

/// Heights of the rings and numbers of nodes on them, beginning with the apex (one node).
struct Plan {
    heights: Vec<f64>,
    counts: Vec<usize>,
}

impl Plan {
    /// Rings with a distance of approximately `edge_mm` in the middle of the wall.
    fn new(shape: &Shape, edge_mm: f64, table: &Meridian) -> Self {
        let spacing = edge_mm * RING_SPACING;
        let n_wall = (table.base_mm / spacing).round().max(3.0) as usize;
        let n_ring = if shape.rim_height > shape.base_height {
            ((table.rim_mm - table.base_mm) / spacing).round().max(1.0) as usize
        } else {
            0
        };
        let below = (0..=n_wall).map(|i| table.base_mm * i as f64 / n_wall as f64);
        let above = (1..=n_ring)
            .map(|i| table.base_mm + (table.rim_mm - table.base_mm) * i as f64 / n_ring as f64);
        let mut heights: Vec<f64> = below.chain(above).map(|s| table.height(s)).collect();
        heights[0] = 0.0;
        heights[n_wall] = 1.0;
        if n_ring > 0 {
            heights[n_wall + n_ring] = 2.0;
        }
        let counts = heights
            .iter()
            .map(|height| {
                let radius = shape.point(0.5, *height, 0.0)[0];
                if *height == 0.0 {
                    1
                } else {
                    (TAU * radius / edge_mm).round().max(6.0) as usize
                }
            })
            .collect();
        Self { heights, counts }
    }

    fn n_columns(&self) -> usize {
        self.counts.iter().sum()
    }
}

/// Table of the arc length along the mid-wall meridian, for evenly spaced rings.
struct Meridian {
    heights: Vec<f64>,
    lengths: Vec<f64>,
    base_mm: f64,
    rim_mm: f64,
}

impl Meridian {
    fn new(shape: &Shape) -> Self {
        let n = 4000;
        let heights: Vec<f64> = (0..=n).map(|i| 2.0 * f64::from(i) / f64::from(n)).collect();
        let mut lengths = vec![0.0];
        for pair in heights.windows(2) {
            let [from, to] = [
                shape.point(0.5, pair[0], 0.0),
                shape.point(0.5, pair[1], 0.0),
            ];
            lengths.push(lengths[lengths.len() - 1] + distance(from, to));
        }
        let (base_mm, rim_mm) = (lengths[n as usize / 2], lengths[n as usize]);
        Self {
            heights,
            lengths,
            base_mm,
            rim_mm,
        }
    }

    fn height(&self, length: f64) -> f64 {
        let i = self
            .lengths
            .partition_point(|at| *at < length)
            .clamp(1, self.lengths.len() - 1);
        let (from, to) = (self.lengths[i - 1], self.lengths[i]);
        let share = if to > from {
            ((length - from) / (to - from)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        self.heights[i - 1] + share * (self.heights[i] - self.heights[i - 1])
    }
}

impl Rings {
    /// Triangulation and number of layers for approximately `n_nodes` nodes. Each number of layers
    /// has an edge length that gives this number of nodes; the one with the best ratio of edge to
    /// layer is taken.
    pub fn for_nodes(shape: &Shape, n_nodes: usize) -> (Self, usize) {
        let table = Meridian::new(shape);
        let mut best: Option<(f64, usize, f64)> = None;
        for n_layers in MIN_LAYERS..=200 {
            let edge_mm = edge_for(shape, &table, n_nodes as f64 / (n_layers + 1) as f64);
            let proportion = (shape.wall_mm / n_layers as f64) / (LAYER_SPACING * edge_mm);
            let badness = proportion.ln().abs();
            if best.is_none_or(|(least, _, _)| badness < least) {
                best = Some((badness, n_layers, edge_mm));
            } else {
                break; // further layers are only thinner
            }
        }
        let (_, n_layers, edge_mm) = best.unwrap_or((0.0, MIN_LAYERS, shape.wall_mm));
        (
            Self::stitch(shape, &Plan::new(shape, edge_mm, &table)),
            n_layers,
        )
    }

    fn stitch(shape: &Shape, plan: &Plan) -> Self {
        let mut columns = Vec::with_capacity(plan.n_columns());
        let mut starts = Vec::new();
        for (i, (height, count)) in plan.heights.iter().zip(&plan.counts).enumerate() {
            starts.push(columns.len() as u32);
            let shift = if i % 2 == 1 { 0.5 } else { 0.0 };
            for j in 0..*count {
                columns.push(Column {
                    height: *height,
                    angle: TAU * (j as f64 + shift) / *count as f64,
                });
            }
        }
        let mut rings = Self {
            columns,
            triangles: Vec::new(),
            in_ring: Vec::new(),
        };
        for i in 0..plan.counts.len() - 1 {
            let (lower, upper) = (
                (starts[i], plan.counts[i]),
                (starts[i + 1], plan.counts[i + 1]),
            );
            rings.join(shape, lower, upper);
            rings
                .in_ring
                .resize(rings.triangles.len(), plan.heights[i] >= 1.0);
        }
        rings
    }

    /// Triangulates the band between two neighbouring rings, going around both and taking the
    /// shorter diagonal each time.
    fn join(&mut self, shape: &Shape, lower: (u32, usize), upper: (u32, usize)) {
        let node = |ring: (u32, usize), i: usize| ring.0 + (i % ring.1) as u32;
        if lower.1 == 1 {
            self.triangles
                .extend((0..upper.1).map(|i| [lower.0, node(upper, i + 1), node(upper, i)]));
            return;
        }
        let mid = |column: u32| {
            let Column { height, angle } = self.columns[column as usize];
            shape.point(0.5, height, angle)
        };
        let closest = (0..upper.1)
            .min_by(|i, j| {
                let away = |k: usize| distance(mid(node(lower, 0)), mid(node(upper, k)));
                away(*i).total_cmp(&away(*j))
            })
            .unwrap_or(0);
        let (mut i, mut j) = (0, 0);
        let mut found = Vec::with_capacity(lower.1 + upper.1);
        while i < lower.1 || j < upper.1 {
            let (low, high) = (node(lower, i), node(upper, closest + j));
            let (low_next, high_next) = (node(lower, i + 1), node(upper, closest + j + 1));
            let step_up = if i == lower.1 {
                true
            } else if j == upper.1 {
                false
            } else {
                distance(mid(low), mid(high_next)) < distance(mid(low_next), mid(high))
            };
            if step_up {
                found.push([low, high_next, high]);
                j += 1;
            } else {
                found.push([low, low_next, high]);
                i += 1;
            }
        }
        self.triangles.extend(found);
    }
}

/// Edge length that gives approximately `n_columns` columns.
fn edge_for(shape: &Shape, table: &Meridian, n_columns: f64) -> f64 {
    let (mut low, mut high) = (
        shape.wall_mm.min(shape.short_mm) * 1e-3,
        4.0 * shape.short_mm,
    );
    for _ in 0..60 {
        let edge = (low * high).sqrt();
        if Plan::new(shape, edge, table).n_columns() as f64 > n_columns {
            low = edge;
        } else {
            high = edge;
        }
    }
    high
}
