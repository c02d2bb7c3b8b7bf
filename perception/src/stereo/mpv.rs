//! Multi-Path-Viterbi over a pyramid (paper, sections 3.2 and 3.4): the coarsest scale searches all
//! disparities, the finer ones windows around it (fast) or all again (full). Slopes measured at a
//! coarser scale let the paths of the finer one follow slanted surfaces at no cost.

use super::blocks::{BLOCK, Blocks};
use super::confidence::Trust;
use super::cost::CostParameters;
use super::disparity::DisparityView;
use super::energy::{EnergyRow, Volumes};
use super::fill::{BridgeParameters, Fill};
use super::matcher::{MatchError, MatchOutput, Matcher, MatcherError};
use super::median::Median;
use super::pyramid::{Coarse, double, half_size, halve};
use super::scale::PathParameters;
use super::solver::Solver;
use super::speckle::{SpeckleFilter, SpeckleParameters};
use super::winner::{SubPixel, Winner, WinnerParameters};
use crate::image::GreyView;
use crate::simd::{LANES, Level};

/// The least width and height of a pair.
pub const MIN_SIZE: usize = 8;

/// The most nodes of an image, two bytes of workspace each: 4096 × 2048 pixels with 128
/// disparities.
pub const MAX_NODES: usize = 1 << 30;

/// The most scales of a pyramid.
pub const SCALES: usize = 3;
/// A coarser scale must be at least this wide and high.
const MIN_COARSE: usize = 16;
/// A coarser scale must have at least this many disparities.
const MIN_DISPARITIES: usize = 8;
/// The widest window at the finest scale and at the one before it.
const WIDEST: [usize; 2] = [96, 48];
/// Larger volumes than this are taken not to stay in a cache.
const CACHE_BYTES: usize = 16 << 20;
/// Islands of fewer pixels are removed at coarser scales.
const COARSE_SPECKLE: u32 = 20;

/// Which nodes the finest scale searches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Search {
    /// All disparities of every pixel.
    Full,
    /// Windows around the coarser map: about a quarter of the nodes at most, as in the paper.
    Windows,
}

/// What shapes the energy and the choice of the winner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MpvParameters {
    /// The matching cost.
    pub cost: CostParameters,
    /// The Viterbi paths.
    pub paths: PathParameters,
    /// Scales of the pyramid where the image is large enough, 1 to [`SCALES`]; with a single one all
    /// disparities are searched, and there are no slopes.
    pub scales: usize,
    /// Whether paths follow the slopes of the coarser map.
    pub slopes: bool,
    /// How the winner is chosen and checked.
    pub winner: WinnerParameters,
    /// Estimates of less confidence are unknown; at the finest scale it is that of the
    /// neighbourhood.
    pub min_confidence: u8,
    /// Which small islands are removed.
    pub speckle: SpeckleParameters,
    /// Which holes are bridged.
    pub bridge: BridgeParameters,
    /// Whether all holes that remain are filled, too.
    pub complete: bool,
    /// Threads that share the work: 1 starts none. The result is the same for any number.
    pub threads: usize,
}

impl Default for MpvParameters {
    fn default() -> Self {
        Self {
            cost: CostParameters::default(),
            paths: PathParameters::default(),
            scales: SCALES,
            slopes: true,
            winner: WinnerParameters::default(),
            min_confidence: 105,
            speckle: SpeckleParameters::default(),
            bridge: BridgeParameters::default(),
            complete: false,
            threads: 1,
        }
    }
}

/// One scale with what it results in.
#[derive(Debug)]
struct Stage {
    solver: Solver,
    /// For the upper and the lower part of the image.
    winners: [Winner; 2],
    speckle: SpeckleFilter,
    /// The pair at this scale; empty at the finest, which uses the caller's.
    left: Vec<u8>,
    right: Vec<u8>,
    disparity: Vec<u16>,
    confidence: Vec<u8>,
    /// The most vectors its blocks may take.
    vectors: usize,
    widest: usize,
}

/// The matcher with its workspace.
#[derive(Debug)]
pub struct Mpv {
    search: Search,
    slopes: bool,
    level: Level,
    width: usize,
    height: usize,
    /// Coarsest first.
    stages: Vec<Stage>,
    volumes: Volumes,
    median: Median,
    trust: Trust,
    min_confidence: u8,
    fill: Fill,
    complete: bool,
    /// The greatest disparity in 1/256 px.
    most: u16,
    /// Nodes that the last pair took.
    nodes: usize,
}

impl Mpv {
    /// Checks whether a matcher can be made, without allocating its workspace.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn check(width: usize, height: usize, disparities: usize) -> Result<(), MatcherError> {
        if width < MIN_SIZE || height < MIN_SIZE {
            return Err(MatcherError::TooSmall { width, height, least: MIN_SIZE });
        }
        if !(2..=255).contains(&disparities) {
            return Err(MatcherError::Disparities(disparities));
        }
        let padded = |size: usize| size.checked_next_multiple_of(BLOCK);
        let nodes = padded(width)
            .zip(padded(height))
            .and_then(|(w, h)| w.checked_mul(h))
            .and_then(|pixels| pixels.checked_mul(disparities));
        match nodes {
            Some(nodes) if nodes <= MAX_NODES => Ok(()),
            _ => Err(MatcherError::TooLarge { width, height, disparities }),
        }
    }

    /// A matcher for pairs of `width` × `height` pixels and disparities 0 to `disparities` − 1, on
    /// the fastest hardware level there is.
    ///
    /// # Errors
    /// When the image is smaller than [`MIN_SIZE`], `disparities` is not 2 to 255, or there are
    /// more than [`MAX_NODES`] nodes.
    pub fn new(
        parameters: MpvParameters,
        search: Search,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Self, MatcherError> {
        Self::at_level(Level::best(), parameters, search, width, height, disparities)
    }

    /// As [`Self::new`], on a given hardware level. The results are the same on all.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn at_level(
        level: Level,
        parameters: MpvParameters,
        search: Search,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Self, MatcherError> {
        Self::check(width, height, disparities)?;
        let sizes = sizes(parameters.scales, width, height, disparities);
        let finest = sizes.len() - 1;
        let mut stages: Vec<Stage> = Vec::with_capacity(sizes.len());
        for (i, &(w, h, d)) in sizes.iter().enumerate() {
            let mut solver =
                Solver::new(parameters.cost, parameters.paths, level, w, h, d, parameters.threads);
            let everything = i == 0 || (i == finest && search == Search::Full);
            let vectors = if everything {
                solver.scale.blocks.vectors()
            } else {
                budget(&solver.scale.blocks, disparities)
            };
            if let Some(coarser) = stages.last() {
                solver.scale.blocks.reserve(coarser.solver.scale.width(), coarser.solver.scale.height());
            }
            if everything && 2 * vectors * LANES > CACHE_BYTES {
                solver.spare_caches();
            }
            let kept = if i == finest { 0 } else { w * h };
            let (winner, speckle) = choices(&parameters, i == finest);
            stages.push(Stage {
                winners: std::array::from_fn(|_| Winner::new(winner, level, w, d)),
                speckle: SpeckleFilter::new(speckle, w, h),
                left: vec![0; kept],
                right: vec![0; kept],
                disparity: vec![0; kept],
                confidence: vec![0; kept],
                vectors,
                widest: widest(finest - i),
                solver,
            });
        }
        let vectors = stages.iter().map(|s| s.vectors).max().unwrap_or(0);
        Ok(Self {
            search,
            slopes: parameters.slopes,
            level,
            width,
            height,
            stages,
            volumes: Volumes::new(vectors),
            median: Median::new(level, width),
            trust: Trust::new(level, width),
            min_confidence: parameters.min_confidence,
            fill: Fill::new(parameters.bridge, width),
            complete: parameters.complete,
            most: ((disparities - 1) * 256) as u16,
            nodes: 0,
        })
    }

    /// The hardware level that the kernels run on.
    pub fn level(&self) -> Level {
        self.level
    }

    /// From winners to the map that is given: doubt from the neighbourhood, outliers, islands, holes.
    fn finish(&mut self, left: GreyView<'_>, output: MatchOutput<'_>) {
        let MatchOutput { disparity, confidence } = output;
        self.trust.apply(confidence);
        for (disparity, confidence) in disparity.iter_mut().zip(confidence.iter_mut()) {
            // Alone in doubt, but not gone: only an unknown pixel has none at all.
            *confidence = (*confidence).max(1);
            *disparity = if *confidence < self.min_confidence { 0 } else { *disparity };
        }
        self.median.apply(disparity);
        if let Some(finest) = self.stages.last_mut() {
            finest.speckle.apply(disparity);
        }
        forget(disparity, confidence);
        self.fill.bridge(disparity, confidence);
        if self.complete {
            self.fill.complete(left, disparity, confidence);
        }
    }

    /// Halves the pair down to the coarsest scale.
    fn build_pyramid(&mut self, left: GreyView<'_>, right: GreyView<'_>) {
        let level = self.level;
        for i in (0..self.stages.len() - 1).rev() {
            let (coarse, fine) = self.stages.split_at_mut(i + 1);
            let (coarse, fine) = (&mut coarse[i], &fine[0]);
            let (w, h) = (fine.solver.scale.width(), fine.solver.scale.height());
            let (from_left, from_right) = if fine.left.is_empty() {
                (Some(left), Some(right))
            } else {
                (GreyView::new(&fine.left, w, h, w).ok(), GreyView::new(&fine.right, w, h, w).ok())
            };
            for (from, to) in [(from_left, &mut coarse.left), (from_right, &mut coarse.right)] {
                if let Some(from) = from {
                    halve(level, from, to);
                }
            }
        }
    }
}

/// Width, height and disparities of all scales, the coarsest first.
pub(super) fn sizes(
    scales: usize,
    width: usize,
    height: usize,
    disparities: usize,
) -> Vec<(usize, usize, usize)> {
    let mut sizes = vec![(width, height, disparities)];
    while sizes.len() < scales.min(SCALES) {
        let (w, h, d) = sizes[0];
        let ((w, h), d) = (half_size(w, h), d.div_ceil(2) + 1);
        if w.min(h) < MIN_COARSE || d < MIN_DISPARITIES {
            break;
        }
        sizes.insert(0, (w, h, d));
    }
    sizes
}

/// The vectors that windows may take: a quarter of the range at the finest scale, as the paper has it,
/// and of half the scale before it; a little less, so that all three stay within 0.3281.
pub(super) fn budget(blocks: &Blocks, finest_disparities: usize) -> usize {
    let (width, height) = blocks.size();
    (width * height * finest_disparities * 24 / 100 / LANES).max(blocks.min_vectors())
}

/// The widest window of a scale that is halved so often.
pub(super) fn widest(halved: usize) -> usize {
    WIDEST[halved.min(1)]
}

/// How a scale chooses its winners, and which islands it removes.
pub(super) fn choices(parameters: &MpvParameters, finest: bool) -> (WinnerParameters, SpeckleParameters) {
    if finest {
        // It asks the neighbourhood, which is known only later.
        return (WinnerParameters { min_confidence: 0, ..parameters.winner }, parameters.speckle);
    }
    // Slopes and windows are measured on the coarser maps: what scatters less serves them better.
    let sub_pixel = match parameters.winner.sub_pixel {
        SubPixel::Data => SubPixel::Energy,
        chosen => chosen,
    };
    let min_confidence = parameters.min_confidence;
    (
        WinnerParameters { min_confidence, sub_pixel, ..parameters.winner },
        SpeckleParameters { min_pixels: COARSE_SPECKLE, ..parameters.speckle },
    )
}

/// Takes the confidence of what is unknown.
fn forget(disparity: &[u16], confidence: &mut [u8]) {
    for (confidence, &disparity) in confidence.iter_mut().zip(disparity) {
        *confidence = if disparity == 0 { 0 } else { *confidence };
    }
}

impl Matcher for Mpv {
    fn compute_within(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<u32, MatchError> {
        let (expected_width, expected_height) = (self.width, self.height);
        for (which, image) in [("left", &left), ("right", &right)] {
            let (width, height) = (image.width(), image.height());
            if (width, height) != (expected_width, expected_height) {
                return Err(MatchError::Size { which, width, height, expected_width, expected_height });
            }
        }
        let needed = self.width * self.height;
        for given in [output.disparity.len(), output.confidence.len()] {
            if given != needed {
                return Err(MatchError::Output { given, needed });
            }
        }
        self.build_pyramid(left, right);
        self.nodes = 0;
        let finest = self.stages.len() - 1;
        for i in 0..=finest {
            let (coarser, rest) = self.stages.split_at_mut(i);
            let stage = &mut rest[0];
            let (width, height) = (stage.solver.scale.width(), stage.solver.scale.height());
            let coarse = coarser.last().and_then(|c| {
                DisparityView::new(&c.disparity, c.solver.scale.width(), c.solver.scale.height())
            });
            if let Some(coarse) = coarse {
                let windows = i < finest || self.search == Search::Windows;
                stage.solver.scale.blocks.plan(
                    self.level,
                    coarse,
                    self.slopes,
                    windows.then_some((stage.widest, stage.vectors)),
                );
            }
            self.nodes += stage.solver.scale.blocks.nodes();
            let (l, r, disparity, confidence) = if i == finest {
                (left, right, &mut *output.disparity, &mut *output.confidence)
            } else {
                let view = |pixels| GreyView::new(pixels, width, height, width);
                match (view(&stage.left), view(&stage.right)) {
                    (Ok(l), Ok(r)) => (l, r, &mut stage.disparity[..], &mut stage.confidence[..]),
                    _ => continue,
                }
            };
            let [above, below] = &mut stage.winners;
            let cut = stage.solver.scale.middle() * width;
            let (upper_disparity, lower_disparity) = disparity.split_at_mut(cut);
            let (upper_confidence, lower_confidence) = confidence.split_at_mut(cut);
            let upper = |row: EnergyRow<'_>| {
                let pixels = row.y * width..(row.y + 1) * width;
                above.row(row, &mut upper_disparity[pixels.clone()], &mut upper_confidence[pixels]);
            };
            let lower = |row: EnergyRow<'_>| {
                let pixels = row.y * width - cut..(row.y + 1) * width - cut;
                below.row(row, &mut lower_disparity[pixels.clone()], &mut lower_confidence[pixels]);
            };
            // The coarsest map is always finished.
            let mut unhurried = || true;
            let hurry: &mut dyn FnMut() -> bool = if i == 0 { &mut unhurried } else { &mut *go_on };
            let done = stage.solver.solve(l, r, &mut self.volumes, hurry, upper, lower);
            if !done {
                let (coarse, times) = (&self.stages[i - 1], (finest + 1 - i) as u32);
                let map = Coarse { disparity: &coarse.disparity, confidence: &coarse.confidence, times };
                double(map, self.width, self.most, output.disparity, output.confidence);
                self.finish(left, output);
                return Ok(times);
            }
            if i < finest {
                stage.speckle.apply(disparity);
                forget(disparity, confidence);
            }
        }
        self.finish(left, output);
        Ok(0)
    }

    fn nodes(&self) -> usize {
        self.nodes
    }

    fn workspace_bytes(&self) -> usize {
        let stages: usize = self
            .stages
            .iter()
            .map(|s| {
                s.solver.bytes()
                    + s.winners.iter().map(Winner::bytes).sum::<usize>()
                    + s.speckle.bytes()
                    + s.left.len()
                    + s.right.len()
                    + 2 * s.disparity.len()
                    + s.confidence.len()
            })
            .sum();
        self.volumes.bytes() + self.median.bytes() + self.trust.bytes() + stages
    }
}

#[cfg(test)]
mod tests;
