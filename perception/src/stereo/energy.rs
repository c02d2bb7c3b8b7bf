//! The energies of all nodes of an image, and how its rows are read.

use super::blocks::Block;
use super::cost::STRIP;
use crate::simd::{LANES, Lanes};

/// The two volumes of an image, one byte a node each; shared by the scales of a pyramid.
#[derive(Debug, Default)]
pub struct Volumes {
    /// H, the energies of the horizontal layer.
    pub(super) merged: Vec<Lanes>,
    /// The costs, then the jumps of the downward paths, then the final energies.
    pub(super) energies: Vec<Lanes>,
}

impl Volumes {
    /// Room for `vectors` vectors of nodes.
    pub fn new(vectors: usize) -> Self {
        Self { merged: vec![Lanes::ZERO; vectors], energies: vec![Lanes::ZERO; vectors] }
    }

    /// Vectors of nodes that there is room for.
    pub fn vectors(&self) -> usize {
        self.merged.len()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        (self.merged.len() + self.energies.len()) * LANES
    }
}

/// A row of final energies.
#[derive(Clone, Copy, Debug)]
pub struct EnergyRow<'a> {
    /// The row of the image.
    pub y: usize,
    /// The blocks that it lies in.
    pub blocks: &'a [Block],
    energies: &'a [Lanes],
    /// Where in the volume `energies` starts.
    base: usize,
}

impl<'a> EnergyRow<'a> {
    /// A row `y` whose energies start at `base` of the volume.
    pub fn new(y: usize, blocks: &'a [Block], energies: &'a [Lanes], base: usize) -> Self {
        Self { y, blocks, energies, base }
    }

    /// The energies of the row in block `tile`: a vector for each disparity of its window.
    pub fn nodes(&self, tile: usize) -> &'a [Lanes] {
        let block = &self.blocks[tile];
        let at = block.at - self.base + self.y % STRIP * block.pitch();
        &self.energies[at..at + block.span()]
    }
}
