//! Frames of the wall at even times of the current beat, for a picture that moves.

use super::heart::{Frame, Wall};
use super::shapes::{Shape, Shapes};

/// Number of equal parts into which the frames divide the beat.
const PARTS: usize = 24;

/// Frames of the current beat.
#[derive(Debug)]
pub struct Frames {
    wall: Wall,
    length_ms: f64,
    /// Number of the beat, from one.
    beat: usize,
    frames: Vec<Frame>,
}

impl Frames {
    /// Starts with the first of `shapes`.
    ///
    /// - `unloaded`: unloaded positions of the mesh's nodes \[mm\], three numbers per node
    #[must_use]
    pub fn begin(wall: Wall, length_ms: f64, shapes: &Shapes, unloaded: &[f64]) -> Self {
        let mut frames = Self {
            wall,
            length_ms,
            beat: shapes.beat,
            frames: Vec::new(),
        };
        frames.add(&shapes.begin, unloaded);
        frames
    }

    /// Continues from a checkpoint with these shapes. If its numbers are not usable, the beat has no
    /// frames.
    pub fn resume(&mut self, shapes: &Shapes, numbers: &[f64]) {
        let length = 1 + 3 * self.frames.first().map_or(0, |frame| frame.places.len());
        self.beat = shapes.beat;
        self.frames.clear();
        if numbers.len().is_multiple_of(length) {
            self.frames
                .extend(numbers.chunks_exact(length).map(|all| Frame {
                    sample: all[0] as usize,
                    places: all[1..].as_chunks::<3>().0.to_vec(),
                }));
        }
    }

    /// Numbers of the frames, for a checkpoint.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        let of = |frame: &Frame| {
            let places = frame.places.as_flattened();
            [&[frame.sample as f64], places].concat()
        };
        self.frames.iter().flat_map(of).collect()
    }

    /// Adds the latest of `shapes` if a frame is due; they must have been updated before. The first
    /// sample of a new beat discards the previous beat.
    ///
    /// - `time_ms`: time in the beat
    pub fn observe(&mut self, shapes: &Shapes, time_ms: f64, unloaded: &[f64]) {
        if shapes.beat != self.beat {
            self.beat = shapes.beat;
            self.frames.clear();
            self.add(&shapes.begin, unloaded);
        }
        // A beat that was resumed without its earlier frames stays without.
        let n = self.frames.len();
        let due_ms = self.length_ms * n as f64 / PARTS as f64;
        if n > 0 && time_ms >= due_ms - 1e-6 {
            self.add(shapes.latest(), unloaded);
        }
    }

    fn add(&mut self, shape: &Shape, unloaded: &[f64]) {
        self.frames.push(Frame {
            sample: shape.sample,
            places: self.wall.places(unloaded, &shape.u),
        });
    }

    /// The wall and its frames in the current beat.
    #[must_use]
    pub fn all(&self) -> (&Wall, &[Frame]) {
        (&self.wall, &self.frames)
    }
}
