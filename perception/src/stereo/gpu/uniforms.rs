//! Parameters of the kernels: the plan of all scales, computed once.

use super::super::blocks::{BLOCK, Blocks};
use super::super::cost::factors;
use super::super::mpv::{MpvParameters, Search, budget, choices, sizes, widest};
use super::super::scale::EdgeWeight;
use super::super::viterbi::Merge;
use super::super::winner::SubPixel;
use crate::simd::LANES;
use bytemuck::{Pod, Zeroable};

/// `Scale` of `common.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct ScaleUniform {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) stride: u32,
    pub(super) disparities: u32,
    pub(super) tiles: u32,
    pub(super) strips: u32,
    pub(super) zero: u32,
    pub(super) merging: u32,
    pub(super) bias: i32,
    pub(super) gradient_limit: u32,
    pub(super) scale_factor: f32,
    pub(super) mean_factor: f32,
    pub(super) coarse_width: u32,
    pub(super) coarse_height: u32,
    pub(super) widest: u32,
    pub(super) budget: u32,
    pub(super) sub_pixel: u32,
    pub(super) left_right: u32,
    pub(super) min_confidence: u32,
    pub(super) speckle_pixels: u32,
    pub(super) speckle_step: u32,
    pub(super) bridge_px: u32,
    pub(super) bridge_step: u32,
    pub(super) min_filtered_confidence: u32,
}

/// `Direction` of `path.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct DirectionUniform {
    pub(super) dx: i32,
    pub(super) down: u32,
    pub(super) smooth: u32,
    pub(super) edge: u32,
    pub(super) levels: u32,
    pub(super) truncation: u32,
    pub(super) reach: i32,
    pub(super) output: u32,
}

/// `Block` of `common.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(super) struct BlockUniform {
    pub(super) low: u32,
    pub(super) high: u32,
    pub(super) at: u32,
    pub(super) spare: u32,
    pub(super) slope_x: i32,
    pub(super) slope_y: i32,
    pub(super) spare_2: [u32; 2],
}

impl BlockUniform {
    /// Number of words per pixel; a word holds four disparities.
    pub(super) fn words(&self) -> u32 {
        self.high.div_ceil(4) - self.low / 4
    }
}

/// One scale of the plan.
#[derive(Clone, Debug)]
pub(super) struct ScalePlan {
    pub(super) uniform: ScaleUniform,
    /// Horizontal, vertical and both diagonal orientations.
    pub(super) directions: [DirectionUniform; 4],
    /// The initial blocks.
    pub(super) blocks: Vec<BlockUniform>,
    /// Whether windows are planned from the coarser map.
    pub(super) windows: bool,
    /// Whether slopes are measured on the coarser map.
    pub(super) slopes: bool,
    /// Number of threads that share a path: a power of two up to 32.
    pub(super) lanes: u32,
    /// Maximum number of words per pixel.
    pub(super) words: u32,
    /// Bytes of a volume.
    pub(super) volume_bytes: u64,
    /// Number of nodes of the image's pixels, if windows are fixed.
    pub(super) nodes: usize,
}

impl ScalePlan {
    pub(super) fn pixels(&self) -> u64 {
        u64::from(self.uniform.width) * u64::from(self.uniform.height)
    }

    pub(super) fn coarse_pixels(&self) -> u64 {
        u64::from(self.uniform.coarse_width) * u64::from(self.uniform.coarse_height)
    }

    /// Bytes of the features of both images.
    pub(super) fn feature_bytes(&self) -> u64 {
        2 * 16 * u64::from(self.uniform.width + 4) * u64::from(self.uniform.height)
    }

    /// Bytes of both images.
    pub(super) fn picture_bytes(&self) -> u64 {
        2 * 4 * u64::from(self.uniform.stride) * u64::from(self.uniform.height)
    }
}

/// All scales, the coarsest first.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) scales: Vec<ScalePlan>,
    pub(super) bridge: bool,
}

impl Plan {
    /// Bytes of the largest buffer.
    pub(super) fn largest_buffer(&self) -> u64 {
        let of = |scale: &ScalePlan| scale.volume_bytes.max(scale.feature_bytes()).max(4 * scale.pixels());
        self.scales.iter().map(of).max().unwrap_or(0)
    }
}

/// Words within which a node can be reached for less than the truncation; further ones are skipped.
fn reach(truncation: u8, weight: EdgeWeight) -> i32 {
    let nodes = u32::from(truncation).div_ceil(u32::from(weight.smooth.min(weight.edge)));
    (nodes.saturating_sub(1)).div_ceil(4) as i32
}

/// Computes the plan of all scales. The sizes must have passed [`Mpv::check`](super::super::mpv::Mpv::check).
pub(super) fn plan(
    parameters: &MpvParameters,
    search: Search,
    width: usize,
    height: usize,
    disparities: usize,
) -> Plan {
    let sizes = sizes(parameters.scales, width, height, disparities);
    let finest = sizes.len() - 1;
    let scales = (0..sizes.len()).map(|i| {
        let (w, h, d) = sizes[i];
        let (coarse_width, coarse_height) = if i > 0 { (sizes[i - 1].0, sizes[i - 1].1) } else { (0, 0) };
        let (winner, speckle) = choices(parameters, i == finest);
        let layout = Blocks::new(w, h, d);
        let everything = i == 0 || (i == finest && search == Search::Full);
        let vectors = budget(&layout, disparities);
        let count = layout.tiles() * layout.strips();
        let words = (d as u32).div_ceil(4);
        let block_words = words as usize * BLOCK * BLOCK;
        let volume_bytes = if everything {
            (count * block_words * 4) as u64
        } else {
            // Windows start and end within words of four disparities: up to three more disparities on either side.
            (vectors * LANES + 6 * BLOCK * BLOCK * count) as u64
        };
        let paths = &parameters.paths;
        let weight = |lambda| EdgeWeight::new(lambda, paths);
        let (horizontal, vertical, diagonal) =
            (weight(paths.lambda_horizontal), weight(paths.lambda_vertical), weight(paths.lambda_diagonal));
        let direction = |dx, down, weight: EdgeWeight, truncation: u8, output| {
            let truncation = truncation.min(75);
            DirectionUniform {
                dx,
                down,
                smooth: weight.smooth.into(),
                edge: weight.edge.into(),
                levels: weight.levels.into(),
                truncation: truncation.into(),
                reach: reach(truncation, weight),
                output,
            }
        };
        let (across, other) = (paths.truncation_horizontal, paths.truncation_other);
        let (scale_factor, mean_factor) = factors();
        ScalePlan {
            uniform: ScaleUniform {
                width: w as u32,
                height: h as u32,
                stride: w.div_ceil(4) as u32,
                disparities: d as u32,
                tiles: layout.tiles() as u32,
                strips: layout.strips() as u32,
                zero: 0,
                merging: match paths.merging {
                    Merge::First => 0,
                    Merge::Min => 1,
                    Merge::Mean => 2,
                },
                bias: parameters.cost.bias(),
                gradient_limit: parameters.cost.gradient_limit.into(),
                scale_factor,
                mean_factor,
                coarse_width: coarse_width as u32,
                coarse_height: coarse_height as u32,
                widest: widest(finest - i).next_multiple_of(2) as u32,
                budget: vectors as u32,
                sub_pixel: match winner.sub_pixel {
                    SubPixel::None => 0,
                    SubPixel::Energy => 1,
                    SubPixel::Data => 2,
                },
                left_right: winner.left_right_px.into(),
                min_confidence: winner.min_confidence.into(),
                speckle_pixels: speckle.min_pixels,
                speckle_step: speckle.step.into(),
                bridge_px: parameters.bridge.widest_px.into(),
                bridge_step: parameters.bridge.step.into(),
                min_filtered_confidence: parameters.min_confidence.into(),
            },
            directions: [
                direction(1, 0, horizontal, across, 0),
                direction(0, 1, vertical, other, 1),
                direction(1, 1, diagonal, other, 2),
                direction(-1, 1, diagonal, other, 2),
            ],
            blocks: (0..count)
                .map(|n| BlockUniform {
                    high: d as u32,
                    at: (n * block_words) as u32,
                    ..BlockUniform::default()
                })
                .collect(),
            windows: !everything,
            slopes: parameters.slopes && i > 0,
            // Two words per lane share the work done once per pixel; windows have few words.
            lanes: if everything { (words.next_power_of_two() / 2).clamp(8, 32) } else { 8 },
            words,
            volume_bytes,
            nodes: if everything { layout.nodes() } else { 0 },
        }
    });
    Plan { scales: scales.collect(), bridge: parameters.bridge.widest_px > 0 }
}
