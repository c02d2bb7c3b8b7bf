//! The energy volumes of an image and a view of one row of final energies.

use super::blocks::{BLOCK, Block};
use crate::simd::{LANES, Lanes};

/// The two volumes of an image, one byte per node each; shared by the scales of a pyramid.
#[derive(Debug, Default)]
pub struct Volumes {
    /// H, the energies of the horizontal layer.
    pub(super) merged: Vec<Lanes>,
    /// The matching costs, later the jump costs of the first vertical sweep.
    pub(super) energies: Vec<Lanes>,
}

impl Volumes {
    /// Allocates `vectors` vectors of nodes.
    pub fn new(vectors: usize) -> Self {
        Self { merged: vec![Lanes::ZERO; vectors], energies: vec![Lanes::ZERO; vectors] }
    }

    /// Capacity in vectors of nodes.
    pub fn vectors(&self) -> usize {
        self.merged.len()
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        (self.merged.len() + self.energies.len()) * LANES
    }
}

/// A row of final energies.
#[derive(Clone, Copy, Debug)]
pub struct EnergyRow<'a> {
    /// The row of the image.
    pub y: usize,
    /// The blocks that the row crosses.
    pub blocks: &'a [Block],
    /// Tile by tile, [`Block::pitch`] vectors each.
    energies: &'a [Lanes],
    /// H of the whole volume.
    merged: &'a [Lanes],
}

impl<'a> EnergyRow<'a> {
    /// Row `y` of `blocks`, whose `energies` are stored tile by tile, [`Block::pitch`] vectors each.
    pub fn new(y: usize, blocks: &'a [Block], energies: &'a [Lanes], merged: &'a [Lanes]) -> Self {
        Self { y, blocks, energies, merged }
    }

    /// H of the row in block `tile`: one vector for each disparity of its window.
    pub fn data(&self, tile: usize) -> &'a [Lanes] {
        let block = &self.blocks[tile];
        let at = block.at + self.y % BLOCK * block.pitch();
        &self.merged[at..at + block.span()]
    }

    /// The energies of the row in block `tile`: one vector for each disparity of its window.
    pub fn nodes(&self, tile: usize) -> &'a [Lanes] {
        let block = &self.blocks[tile];
        // In the volume, blocks are consecutive as well, each with all its rows.
        let at = (block.at - self.blocks[0].at) / BLOCK;
        &self.energies[at..at + block.span()]
    }
}
