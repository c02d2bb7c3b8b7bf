//! Blocks of 2 × 2 cells: their histograms, normalised as OpenCV's L2-Hys, and the sums of the SVM over them.

use super::{BINS, CELL};
use crate::simd::{Simd, kernel};

/// Values of a block: a histogram for each of its cells. The cells are in OpenCV's order, column by column.
pub const BLOCK: usize = 4 * BINS;

/// Floats from one block to the next: whole vectors, the last four are zero.
pub const BLOCK_STRIDE: usize = 40;

/// Largest value of a block that is normalised once: OpenCV's `L2HysThreshold`.
const CLIP: f32 = 0.2;

/// Added to the norm of a block before it is clipped, for each value: OpenCV's constant.
const FIRST_FLOOR: f32 = 0.1 * BLOCK as f32;

/// Added to the norm of a block after it was clipped: OpenCV's constant.
const SECOND_FLOOR: f32 = 1e-3;

kernel! {
    /// The normalised blocks of a row from the sums of their columns ([`super::gradient::CellRow::add`]).
    pub fn blocks(sums: &[f32], columns: usize, weights: &[[f32; 2 * CELL]; 2], out: &mut [f32]) = blocks_of
}

kernel! {
    /// Sum of products of `rows` rows of blocks with the weights of a window: row i of the window starts at
    /// `i * stride` of `blocks`, and has as many values as a row of `weights`.
    pub fn window_sum(weights: &[f32], rows: usize, blocks: &[f32], stride: usize, out: &mut f32) = window_sum_of
}

/// Sum of eight lanes, in the order of all levels.
#[inline(always)]
fn sum_of(p: &[f32; 8]) -> f32 {
    ((p[0] + p[4]) + (p[2] + p[6])) + ((p[1] + p[5]) + (p[3] + p[7]))
}

#[inline(always)]
fn blocks_of<S: Simd>(_: S, sums: &[f32], columns: usize, weights: &[[f32; 2 * CELL]; 2], out: &mut [f32]) {
    let count = (columns / CELL).saturating_sub(1);
    for (i, block) in out[..count * BLOCK_STRIDE].chunks_exact_mut(BLOCK_STRIDE).enumerate() {
        for down in 0..2 {
            for bin in 0..BINS {
                let values = &sums[(down * BINS + bin) * columns + i * CELL..][..2 * CELL];
                for across in 0..2 {
                    let weights = &weights[across];
                    let mut parts = [0.0_f32; 8];
                    for k in 0..CELL {
                        parts[k] = values[k] * weights[k] + values[CELL + k] * weights[CELL + k];
                    }
                    block[(2 * across + down) * BINS + bin] = sum_of(&parts);
                }
            }
        }
        block[BLOCK..].fill(0.0);
        let scale = 1.0 / (norm(block) + FIRST_FLOOR);
        for value in block.iter_mut() {
            let scaled = *value * scale;
            *value = if scaled < CLIP { scaled } else { CLIP };
        }
        let scale = 1.0 / (norm(block) + SECOND_FLOOR);
        block.iter_mut().for_each(|value| *value *= scale);
    }
}

/// Root of the sum of squares of a block.
#[inline(always)]
fn norm(block: &[f32]) -> f32 {
    let mut parts = [0.0_f32; 8];
    for eight in block.chunks_exact(8) {
        for k in 0..8 {
            parts[k] += eight[k] * eight[k];
        }
    }
    sum_of(&parts).sqrt()
}

#[inline(always)]
fn window_sum_of<S: Simd>(_: S, weights: &[f32], rows: usize, blocks: &[f32], stride: usize, out: &mut f32) {
    let width = weights.len() / rows.max(1);
    let mut parts = [0.0_f32; BLOCK_STRIDE];
    for row in 0..rows {
        let weights = &weights[row * width..][..width];
        let blocks = &blocks[row * stride..][..width];
        for (weights, block) in weights.chunks_exact(BLOCK_STRIDE).zip(blocks.chunks_exact(BLOCK_STRIDE)) {
            for k in 0..BLOCK_STRIDE {
                parts[k] += weights[k] * block[k];
            }
        }
    }
    let mut eight = [0.0_f32; 8];
    for part in parts.chunks_exact(8) {
        for k in 0..8 {
            eight[k] += part[k];
        }
    }
    *out = sum_of(&eight);
}
