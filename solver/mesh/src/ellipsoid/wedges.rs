//! Division of the wedges between layers into three tetrahedra each.

use super::rings::Rings;

/// A tetrahedron of a wedge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WedgeTet {
    /// Nodes of the corners; the node of column c and layer l is c (n_layers + 1) + l.
    pub corners: [u32; 4],
    /// Whether the tetrahedron belongs to the passive ring.
    pub in_ring: bool,
}

/// Splits every wedge along diagonals from the column of lower rank at the inner layer to the other
/// column at the outer layer. Ranks are hashes that differ between layers and are always the same
/// for a mesh. With one ranking for all layers, diagonals would wind around the heart in one
/// direction, and the discrete wall would twist under load.
pub fn split(rings: &Rings, n_layers: usize) -> Vec<WedgeTet> {
    let step = n_layers as u32 + 1;
    let mut tets = Vec::with_capacity(3 * n_layers * rings.triangles.len());
    for (triangle, in_ring) in rings.triangles.iter().zip(&rings.in_ring) {
        for layer in 0..n_layers as u32 {
            let rank = |column: u32| (mix(u64::from(column) << 32 | u64::from(layer)), column);
            let mut sorted = *triangle;
            sorted.sort_unstable_by_key(|column| rank(*column));
            let even =
                (0..3).any(|turn| std::array::from_fn(|i| triangle[(i + turn) % 3]) == sorted);
            let [p, q, r] = sorted.map(|column| column * step + layer);
            for mut corners in [
                [p, q, r, r + 1],
                [p, q, r + 1, q + 1],
                [p, q + 1, r + 1, p + 1],
            ] {
                if !even {
                    corners.swap(1, 2);
                }
                tets.push(WedgeTet {
                    corners,
                    in_ring: *in_ring,
                });
            }
        }
    }
    tets
}

/// The finaliser of SplitMix64, a fixed bit mixer.
fn mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
