//! One scale of the pyramid: path parameters, search windows and the guide image for edge weights.
//! All threads of [`super::solver::Solver`] share it.

use super::blocks::Blocks;
use super::viterbi::{Merge, PAD};
use crate::image::GreyView;
use crate::simd::{LANES, Lanes, Level};

/// Parameters of the Viterbi paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathParameters {
    /// λ, the smoothness weight of horizontal paths, in units of the cost (0 to about 100).
    pub lambda_horizontal: u8,
    /// λ of vertical paths.
    pub lambda_vertical: u8,
    /// λ of diagonal paths.
    pub lambda_diagonal: u8,
    /// Maximum cost of a disparity jump on a horizontal path.
    pub truncation_horizontal: u8,
    /// Maximum cost of a disparity jump on vertical and diagonal paths; at most 75.
    pub truncation_other: u8,
    /// Grey-level difference from which a step on a path counts as an image edge.
    pub edge_levels: u8,
    /// λ at an image edge, in percent of the λ elsewhere.
    pub edge_percent: u8,
    /// How rightward and leftward paths are merged to H.
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

/// The weight of a step by the change of the grey value: the paper's λ·e^(−|G|), quantised to two values.
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

/// Data of a scale that all threads of a solver share and only read while they solve a pair.
#[derive(Debug)]
pub struct Scale {
    pub(super) parameters: PathParameters,
    pub(super) horizontal: EdgeWeight,
    /// Weights of vertical, rightward and leftward diagonal paths.
    pub(super) others: [EdgeWeight; 3],
    pub(super) level: Level,
    pub(super) width: usize,
    pub(super) height: usize,
    /// The search window of each block.
    pub blocks: Blocks,
    /// The left image with a border of one vector on both sides.
    guide: Vec<u8>,
    /// Zeros: the energies at the start of a path.
    pub(super) fresh: Vec<Lanes>,
    /// 255 (no node) in lanes inside the image, 0 in lanes beyond it, where a leftward path starts.
    pub(super) edge: Lanes,
}

impl Scale {
    /// A scale of `width` × `height` pixels that searches all disparities below `disparities`.
    pub(super) fn new(
        parameters: PathParameters,
        level: Level,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        // The sum of the three jumps of a sweep must fit into one byte.
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

    /// Bytes of memory held.
    pub(super) fn bytes(&self) -> usize {
        self.fresh.len() * LANES + self.guide.len() + self.blocks.bytes()
    }

    /// Copies the left image and replicates its border columns.
    pub(super) fn take_guide(&mut self, left: GreyView<'_>) {
        let stride = self.guide.len() / self.height;
        for (y, row) in self.guide.chunks_exact_mut(stride).enumerate() {
            let source = left.row(y);
            row[..LANES].fill(source[0]);
            row[LANES..LANES + source.len()].copy_from_slice(source);
            row[LANES + source.len()..].fill(source[source.len() - 1]);
        }
    }

    /// A row of the guide image, shifted by `sideways` pixels.
    pub(super) fn guide_row(&self, y: usize, sideways: isize) -> &[u8] {
        let stride = self.guide.len() / self.height;
        let start = (y * stride + LANES).wrapping_add_signed(sideways);
        &self.guide[start..start + self.blocks.tiles() * LANES]
    }
}
