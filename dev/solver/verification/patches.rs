//! Elements in patches over their common faces.

use std::collections::BTreeMap;

/// Pairs of elements that share a face.
pub fn neighbours(tets: &[[u32; 4]]) -> Vec<(usize, usize)> {
    let mut behind = BTreeMap::new();
    let mut pairs = vec![];
    for (e, tet) in tets.iter().enumerate() {
        for left_out in 0..4 {
            let mut face: Vec<u32> = (0..4).filter(|k| *k != left_out).map(|k| tet[k]).collect();
            face.sort_unstable();
            if let Some(other) = behind.insert(face, e) {
                pairs.push((other, e));
            }
        }
    }
    pairs
}

/// Elements in patches of about `size`, each grown over faces to the neighbour with the most vertices in common; what stays
/// below half of it joins the smallest patch next to it.
pub fn patches(tets: &[[u32; 4]], size: usize) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    let mut beside = vec![vec![]; tets.len()];
    for (a, b) in neighbours(tets) {
        beside[a].push(b);
        beside[b].push(a);
    }
    let mut patch_of = vec![NONE; tets.len()];
    let mut members: Vec<Vec<usize>> = vec![];
    for first in 0..tets.len() {
        if patch_of[first] != NONE {
            continue;
        }
        let mut patch = vec![first];
        patch_of[first] = members.len() as u32;
        while patch.len() < size {
            let common = |e: usize| {
                let within = |v: &&u32| patch.iter().any(|m| tets[*m].contains(v));
                tets[e].iter().filter(within).count()
                    + beside[e].iter().filter(|b| patch.contains(b)).count()
            };
            let free = patch
                .iter()
                .flat_map(|m| &beside[*m])
                .copied()
                .filter(|e| patch_of[*e] == NONE);
            let Some(next) = free.max_by_key(|e| (common(*e), std::cmp::Reverse(*e))) else {
                break;
            };
            patch_of[next] = members.len() as u32;
            patch.push(next);
        }
        members.push(patch);
    }
    for small in 0..members.len() {
        if 2 * members[small].len() >= size {
            continue;
        }
        let around = members[small]
            .iter()
            .flat_map(|m| &beside[*m])
            .map(|e| patch_of[*e] as usize);
        if let Some(other) = around
            .filter(|p| *p != small)
            .min_by_key(|p| (members[*p].len(), *p))
        {
            let moved = std::mem::take(&mut members[small]);
            moved.iter().for_each(|m| patch_of[*m] = other as u32);
            members[other].extend(moved);
        }
    }
    // Numbers without gaps.
    let mut number = vec![NONE; members.len()];
    for (n, (to, _)) in number
        .iter_mut()
        .zip(&members)
        .filter(|(_, m)| !m.is_empty())
        .enumerate()
    {
        *to = n as u32;
    }
    patch_of.iter().map(|p| number[*p as usize]).collect()
}
