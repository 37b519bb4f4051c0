//! Values at nodes, in either precision, as halos send them.

/// Values at the nodes of a rank, node after node. Messages hold double precision, so that single precision passes unchanged.
#[derive(Debug)]
pub enum NodalValues<'a> {
    /// In double precision.
    Double(&'a mut [f64]),
    /// In single precision.
    Single(&'a mut [f32]),
}

fn of(node: u32, width: usize) -> std::ops::Range<usize> {
    node as usize * width..(node as usize + 1) * width
}

impl NodalValues<'_> {
    /// Appends the values of `nodes`, `width` each, to a message.
    pub fn read(&self, nodes: &[u32], width: usize, message: &mut Vec<f64>) {
        match self {
            Self::Double(values) => nodes
                .iter()
                .for_each(|node| message.extend_from_slice(&values[of(*node, width)])),
            Self::Single(values) => nodes.iter().for_each(|node| {
                message.extend(values[of(*node, width)].iter().map(|x| f64::from(*x)));
            }),
        }
    }

    /// Overwrites the values of `nodes` by those of a message.
    pub fn write(&mut self, nodes: &[u32], width: usize, message: &[f64]) {
        for (node, from) in nodes.iter().zip(message.chunks_exact(width)) {
            match self {
                Self::Double(values) => values[of(*node, width)].copy_from_slice(from),
                Self::Single(values) => values[of(*node, width)]
                    .iter_mut()
                    .zip(from)
                    .for_each(|(to, from)| *to = *from as f32),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_precision_passes_unchanged() {
        let mut from: Vec<f32> = (0..9).map(|k| (k as f32).sin()).collect();
        let (mut to, mut message) = (vec![0.0_f32; 9], vec![]);
        NodalValues::Single(&mut from).read(&[2, 0], 3, &mut message);
        NodalValues::Single(&mut to).write(&[0, 1], 3, &message);
        assert_eq!((&to[..3], &to[3..6]), (&from[6..], &from[..3]));
        let mut double = vec![0.0; 3];
        NodalValues::Double(&mut double).write(&[0], 3, &message);
        assert_eq!(
            double,
            from[6..].iter().map(|x| f64::from(*x)).collect::<Vec<_>>()
        );
    }
}
