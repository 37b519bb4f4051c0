//! Cavity volume between an endocardium and the flat caps of its openings.

use crate::surface::{SurfaceDefect, openings};
use crate::vec3::{Vec3, add, cross, dot, scale, sub};
use cardiotwin_units::Ml;

/// A closed surface around a cavity: an endocardium and its openings, each closed by a fan of
/// triangles around the mean of its nodes.
///
/// With x̄ the mean of the first opening's nodes, the volume is −1/6 Σ (x₀ − x̄)·((x₁ − x̄) × (x₂ −
/// x̄)) over the endocardium, whose normals point into the cavity, and the further openings' fans;
/// the first opening's own fan contributes nothing, because each of its triangles holds x̄.
#[derive(Debug, Clone, PartialEq)]
pub struct Cavity {
    /// Endocardial triangles. Their normals point out of the tissue, that is, into the cavity.
    pub triangles: Vec<[u32; 3]>,
    /// Closed loops of nodes around the openings, in the direction of the triangles' edges.
    pub openings: Vec<Vec<u32>>,
}

impl Cavity {
    /// The cavity that an endocardium encloses.
    ///
    /// # Errors
    /// [`SurfaceDefect`] if the triangles do not form an oriented surface.
    pub fn behind(triangles: &[[u32; 3]]) -> Result<Self, SurfaceDefect> {
        Ok(Self {
            triangles: triangles.to_vec(),
            openings: openings(triangles)?,
        })
    }

    /// Mean position of an opening's nodes \[mm\].
    #[must_use]
    pub fn opening_centre_mm(&self, opening: usize, nodes_mm: &[Vec3]) -> Vec3 {
        let nodes = &self.openings[opening];
        let sum = nodes
            .iter()
            .fold([0.0; 3], |sum, node| add(sum, nodes_mm[*node as usize]));
        scale(sum, 1.0 / nodes.len() as f64)
    }

    /// Enclosed volume \[mm³\] for given positions of the mesh's nodes \[mm\]. It is positive if
    /// the endocardium's normals point into the cavity.
    #[must_use]
    pub fn volume_mm3(&self, nodes_mm: &[Vec3]) -> f64 {
        let origin = if self.openings.is_empty() {
            self.triangles
                .first()
                .map_or([0.0; 3], |t| nodes_mm[t[0] as usize])
        } else {
            self.opening_centre_mm(0, nodes_mm)
        };
        let six =
            |a: Vec3, b: Vec3, c: Vec3| dot(sub(a, origin), cross(sub(b, origin), sub(c, origin)));
        let mut total = 0.0;
        for t in &self.triangles {
            let [a, b, c] = t.map(|node| nodes_mm[node as usize]);
            total += six(a, b, c);
        }
        for (k, nodes) in self.openings.iter().enumerate().skip(1) {
            let centre = self.opening_centre_mm(k, nodes_mm);
            for (i, node) in nodes.iter().enumerate() {
                let next = nodes[(i + 1) % nodes.len()];
                // Against the rim's direction, so that cap and endocardium have the same
                // orientation.
                total += six(nodes_mm[next as usize], nodes_mm[*node as usize], centre);
            }
        }
        -total / 6.0
    }

    /// Enclosed volume as [`Self::volume_mm3`], in millilitres.
    #[must_use]
    pub fn volume(&self, nodes_mm: &[Vec3]) -> Ml {
        Ml(self.volume_mm3(nodes_mm) * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Surface of the unit cube as seen from the tissue around a cavity: its normals point inwards.
    fn cube() -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let nodes = (0..8)
            .map(|i| {
                [
                    f64::from(i & 1),
                    f64::from(i >> 1 & 1),
                    f64::from(i >> 2 & 1),
                ]
            })
            .collect();
        let quads = [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ];
        let triangles = quads
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
            .collect();
        (nodes, triangles)
    }

    #[test]
    fn the_volume_of_a_cube_does_not_depend_on_its_openings() {
        let (nodes, triangles) = cube();
        let closed = Cavity::behind(&triangles).unwrap();
        assert!(closed.openings.is_empty());
        assert!((closed.volume_mm3(&nodes) - 1.0).abs() < 1e-14);
        let open = Cavity::behind(&triangles[2..]).unwrap();
        assert_eq!(open.openings.len(), 1);
        assert!((open.volume_mm3(&nodes) - 1.0).abs() < 1e-14);
        let tube = Cavity::behind(&triangles[4..]).unwrap();
        assert_eq!(tube.openings.len(), 2);
        assert!((tube.volume_mm3(&nodes) - 1.0).abs() < 1e-14);
    }
}
