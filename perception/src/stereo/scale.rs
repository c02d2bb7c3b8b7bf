//! One scale of the pyramid: its parameters, its search windows and the image that guides its paths.
//! All threads of [`super::solver::Solver`] read it.

use super::blocks::Blocks;
use super::cost::STRIP;
use super::viterbi::{Merge, PAD};
use crate::image::GreyView;
use crate::simd::{LANES, Lanes, Level};

/// What shapes the paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathParameters {
    /// λ of horizontal paths, in units of the cost (0 to about 100).
    pub lambda_horizontal: u8,
    /// λ of vertical paths.
    pub lambda_vertical: u8,
    /// λ of diagonal paths.
    pub lambda_diagonal: u8,
    /// A jump of a horizontal path never costs more than this.
    pub truncation_horizontal: u8,
    /// A jump of another path never costs more than this; at most 75.
    pub truncation_other: u8,
    /// From this many grey levels on, a step on a path is an edge.
    pub edge_levels: u8,
    /// λ at an edge, in percent.
    pub edge_percent: u8,
    /// How rightward and leftward paths become H.
    pub merging: Merge,
}

impl Default for PathParameters {
    fn default() -> Self {
        Self {
            lambda_horizontal: 6,
            lambda_vertical: 8,
            lambda_diagonal: 20,
            truncation_horizontal: 12,
            truncation_other: 65,
            edge_levels: 20,
            edge_percent: 85,
            merging: Merge::Min,
        }
    }
}

/// The weight of a step by how much the grey value changes: λ·e^(−|G|) of the paper in two steps.
#[derive(Clone, Copy, Debug)]
pub struct EdgeWeight {
    pub(super) smooth: u8,
    pub(super) edge: u8,
    pub(super) levels: u8,
}

impl EdgeWeight {
    pub(super) fn new(lambda: u8, parameters: &PathParameters) -> Self {
        let edge = (u32::from(lambda) * u32::from(parameters.edge_percent.min(100)) + 50) / 100;
        Self { smooth: lambda.max(1), edge: (edge as u8).max(1), levels: parameters.edge_levels }
    }
}

/// What the threads of a solver share and only read while a pair is being solved.
#[derive(Debug)]
pub struct Scale {
    pub(super) parameters: PathParameters,
    pub(super) horizontal: EdgeWeight,
    /// Of straight, rightward and leftward paths.
    pub(super) others: [EdgeWeight; 3],
    pub(super) level: Level,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Which disparities are searched where.
    pub blocks: Blocks,
    /// The left image with a vector of border on both sides.
    guide: Vec<u8>,
    /// Zero: where a path starts.
    pub(super) fresh: Vec<Lanes>,
    /// No node, but where a lane lies beyond the image: there a leftward path starts.
    pub(super) edge: Lanes,
}

impl Scale {
    /// A scale of `width` × `height` pixels and all disparities below `disparities`.
    pub(super) fn new(
        parameters: PathParameters,
        level: Level,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        // Three jumps of a sweep add up in one byte.
        let parameters = PathParameters {
            truncation_horizontal: parameters.truncation_horizontal.min(75),
            truncation_other: parameters.truncation_other.min(75),
            ..parameters
        };
        let blocks = Blocks::new(width, height, disparities);
        let tiles = blocks.tiles();
        let padded = disparities + 2 * PAD;
        Self {
            horizontal: EdgeWeight::new(parameters.lambda_horizontal, &parameters),
            others: [parameters.lambda_vertical, parameters.lambda_diagonal, parameters.lambda_diagonal]
                .map(|lambda| EdgeWeight::new(lambda, &parameters)),
            level,
            width,
            height,
            guide: vec![0; (tiles + 2) * LANES * height],
            fresh: vec![Lanes::ZERO; padded],
            edge: Lanes(std::array::from_fn(
                |lane| {
                    if (tiles - 1) * LANES + lane < width { u8::MAX } else { 0 }
                },
            )),
            blocks,
            parameters,
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.fresh.len() * LANES + self.guide.len() + self.blocks.bytes()
    }

    /// The row where the lower part of the image begins; see [`super::solver::Solver::solve`].
    pub fn middle(&self) -> usize {
        self.blocks.strips() / 2 * STRIP
    }

    /// Copies the left image, its border repeated sideways.
    pub(super) fn take_guide(&mut self, left: GreyView<'_>) {
        let stride = self.guide.len() / self.height;
        for (y, row) in self.guide.chunks_exact_mut(stride).enumerate() {
            let source = left.row(y);
            row[..LANES].fill(source[0]);
            row[LANES..LANES + source.len()].copy_from_slice(source);
            row[LANES + source.len()..].fill(source[source.len() - 1]);
        }
    }

    /// A row of the guide, moved `sideways` pixels.
    pub(super) fn guide_row(&self, y: usize, sideways: isize) -> &[u8] {
        let stride = self.guide.len() / self.height;
        let start = (y * stride + LANES).wrapping_add_signed(sideways);
        &self.guide[start..start + self.blocks.tiles() * LANES]
    }
}
