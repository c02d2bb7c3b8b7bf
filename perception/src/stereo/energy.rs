//! The energies of all nodes of an image, and how its rows are read.

use super::blocks::{BLOCK, Block};
use crate::simd::{LANES, Lanes};

/// The two volumes of an image, one byte a node each; shared by the scales of a pyramid.
#[derive(Debug, Default)]
pub struct Volumes {
    /// H, the energies of the horizontal layer.
    pub(super) merged: Vec<Lanes>,
    /// The costs, then the jumps of the first vertical sweep.
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
    /// Tile by tile, [`Block::pitch`] vectors each.
    energies: &'a [Lanes],
}

impl<'a> EnergyRow<'a> {
    /// A row `y` through `blocks`, whose `energies` lie tile by tile, [`Block::pitch`] vectors each.
    pub fn new(y: usize, blocks: &'a [Block], energies: &'a [Lanes]) -> Self {
        Self { y, blocks, energies }
    }

    /// The energies of the row in block `tile`: a vector for each disparity of its window.
    pub fn nodes(&self, tile: usize) -> &'a [Lanes] {
        let block = &self.blocks[tile];
        // Blocks lie one after the other in the volume, too, with all their rows.
        let at = (block.at - self.blocks[0].at) / BLOCK;
        &self.energies[at..at + block.span()]
    }
}
