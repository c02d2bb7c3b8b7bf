//! The Multi-Path-Viterbi matcher on an image pyramid (paper, sections 3.2 and 3.4).
//!
//! The coarsest scale searches all disparities. Finer scales search windows around the coarser map; the finest
//! scale searches either windows (fast) or again all disparities (full). Slopes measured at the coarser scale
//! let the paths of the finer scale follow slanted surfaces without jump costs.

use super::blocks::{BLOCK, Blocks};
use super::confidence::ConfidenceFilter;
use super::cost::CostParameters;
use super::crew::Crew;
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

/// Minimum width and height of a pair, in pixels.
pub const MIN_SIZE: usize = 8;

/// Maximum number of nodes of an image, with two bytes of workspace each: 4096 × 2048 pixels with 128
/// disparities.
pub const MAX_NODES: usize = 1 << 30;

/// Maximum number of scales of the pyramid.
pub const SCALES: usize = 3;
/// Minimum width and height of a coarser scale.
const MIN_COARSE: usize = 16;
/// Minimum number of disparities of a coarser scale.
const MIN_DISPARITIES: usize = 8;
/// Maximum window size in disparities, at the finest scale and at the next coarser one.
const WIDEST: [usize; 2] = [96, 48];
/// Mean size of the windows at most, in percent of the disparities of the finest scale. The paper allows a quarter of the
/// full range at the finest scale, and half at the scale before it; 24 keeps the total of three scales within 0.3281.
const BUDGET_PERCENT: usize = 24;
/// Mean size of the windows at most, in hundredths of a disparity: limits the workspace where there are many
/// disparities. At 128, one of KITTI 2015's 18 pairs would take more (docs/algorithms.md, node count).
const BUDGET_HUNDREDTHS: usize = 2050;
/// Volumes larger than this are assumed not to fit into the caches.
const CACHE_BYTES: usize = 16 << 20;
/// Minimum size of a connected region at coarser scales, in pixels.
const COARSE_SPECKLE: u32 = 20;

/// Which nodes the finest scale searches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Search {
    /// All disparities of every pixel.
    Full,
    /// Windows around the coarser map: at most about a quarter of the nodes, as in the paper.
    Windows,
}

/// Parameters of the matcher.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MpvParameters {
    /// The matching cost.
    pub cost: CostParameters,
    /// The Viterbi paths.
    pub paths: PathParameters,
    /// Maximum number of scales of the pyramid, 1 to [`SCALES`]; small images get fewer. With a single scale
    /// all disparities are searched and slopes are not used.
    pub scales: usize,
    /// Whether paths follow the slopes of the coarser map.
    pub slopes: bool,
    /// Selection of the winner and left-right check.
    pub winner: WinnerParameters,
    /// Minimum confidence of an estimate, 0 to 255; at the finest scale it applies to the confidence of the
    /// neighbourhood.
    pub min_confidence: u8,
    /// Removal of small regions.
    pub speckle: SpeckleParameters,
    /// Interpolation of small holes.
    pub bridge: BridgeParameters,
    /// Whether all remaining holes are filled.
    pub complete: bool,
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
        }
    }
}

/// One scale of the pyramid with its images and its map.
#[derive(Debug)]
struct PyramidScale {
    solver: Solver,
    /// Winner selection for the upper and the lower part of the image.
    winners: [Winner; 2],
    speckle: SpeckleFilter,
    /// The pair at this scale; empty at the finest scale, which uses the caller's images.
    left: Vec<u8>,
    right: Vec<u8>,
    disparity: Vec<u16>,
    confidence: Vec<u8>,
    /// Budget of its windows, in vectors.
    vectors: usize,
    /// Maximum size of a window, in disparities.
    widest: usize,
}

/// The Multi-Path-Viterbi matcher on the CPU, with its workspace.
#[derive(Debug)]
pub struct Mpv {
    crew: Crew,
    search: Search,
    slopes: bool,
    level: Level,
    width: usize,
    height: usize,
    /// Coarsest first.
    pyramid: Vec<PyramidScale>,
    volumes: Volumes,
    median: Median,
    confidence_filter: ConfidenceFilter,
    min_confidence: u8,
    fill: Fill,
    complete: bool,
    /// Maximum disparity in 1/256 px.
    most: u16,
    /// Nodes of the last pair.
    nodes: usize,
}

impl Mpv {
    /// Checks the size and the number of disparities without allocating a workspace.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn check(width: usize, height: usize, disparities: usize) -> Result<(), MatcherError> {
        if width < MIN_SIZE || height < MIN_SIZE {
            return Err(MatcherError::TooSmall { width, height, min: MIN_SIZE });
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
    /// the fastest instruction-set level of this machine.
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

    /// As [`Self::new`], on a given instruction-set level. The results are the same on all levels.
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
        Self::with_crew(Crew::default(), level, parameters, search, width, height, disparities)
    }

    /// As [`Self::at_level`], on the threads of a crew. The results are the same for any number of threads.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_crew(
        crew: Crew,
        level: Level,
        parameters: MpvParameters,
        search: Search,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Self, MatcherError> {
        let threads = crew.threads();
        Self::check(width, height, disparities)?;
        let sizes = sizes(parameters.scales, width, height, disparities);
        let finest = sizes.len() - 1;
        let mut pyramid: Vec<PyramidScale> = Vec::with_capacity(sizes.len());
        for (i, &(w, h, d)) in sizes.iter().enumerate() {
            let mut solver = Solver::new(parameters.cost, parameters.paths, level, w, h, d, threads);
            let everything = i == 0 || (i == finest && search == Search::Full);
            let vectors = if everything {
                solver.scale.blocks.vectors()
            } else {
                budget(&solver.scale.blocks, disparities)
            };
            if let Some(coarser) = pyramid.last() {
                solver.scale.blocks.reserve(coarser.solver.scale.width(), coarser.solver.scale.height());
            }
            if everything && 2 * vectors * LANES > CACHE_BYTES {
                solver.spare_caches();
            }
            let kept = if i == finest { 0 } else { w * h };
            let (winner, speckle) = choices(&parameters, i == finest);
            pyramid.push(PyramidScale {
                winners: std::array::from_fn(|_| Winner::new(winner, level, w, d)),
                speckle: SpeckleFilter::new(level, speckle, w, h, threads),
                left: vec![0; kept],
                right: vec![0; kept],
                disparity: vec![0; kept],
                confidence: vec![0; kept],
                vectors,
                widest: widest(finest - i),
                solver,
            });
        }
        let vectors = pyramid.iter().map(|s| s.vectors).max().unwrap_or(0);
        Ok(Self {
            crew,
            search,
            slopes: parameters.slopes,
            level,
            width,
            height,
            pyramid,
            volumes: Volumes::new(vectors),
            median: Median::new(level, width, threads),
            confidence_filter: ConfidenceFilter::new(level, width, threads),
            min_confidence: parameters.min_confidence,
            fill: Fill::new(parameters.bridge, width, threads),
            complete: parameters.complete,
            most: ((disparities - 1) * 256) as u16,
            nodes: 0,
        })
    }

    /// The instruction-set level that the kernels run on.
    pub fn level(&self) -> Level {
        self.level
    }

    /// Post-processing of the finest map: confidence of the neighbourhood, median, speckle filter, hole filling.
    fn finish(&mut self, left: GreyView<'_>, output: MatchOutput<'_>) {
        let MatchOutput { disparity, confidence } = output;
        self.confidence_filter.apply(confidence);
        for (disparity, confidence) in disparity.iter_mut().zip(confidence.iter_mut()) {
            // An isolated estimate keeps a confidence of 1; only unknown pixels have 0.
            *confidence = (*confidence).max(1);
            *disparity = if *confidence < self.min_confidence { 0 } else { *disparity };
        }
        self.median.apply(disparity);
        if let Some(finest) = self.pyramid.last_mut() {
            finest.speckle.apply(disparity);
        }
        clear_unknown(disparity, confidence);
        self.fill.bridge(disparity, confidence);
        if self.complete {
            self.fill.complete(left, disparity, confidence);
        }
    }

    /// Matches a pair of the right size, scale by scale. Returns how often the resolution of the result was halved.
    fn match_scales(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        go_on: &mut (dyn FnMut() -> bool + Send),
    ) -> u32 {
        self.build_pyramid(left, right);
        self.nodes = 0;
        let finest = self.pyramid.len() - 1;
        for i in 0..=finest {
            let (coarser, rest) = self.pyramid.split_at_mut(i);
            let current = &mut rest[0];
            let (width, height) = (current.solver.scale.width(), current.solver.scale.height());
            let coarse = coarser.last().and_then(|c| {
                DisparityView::new(&c.disparity, c.solver.scale.width(), c.solver.scale.height())
            });
            if let Some(coarse) = coarse {
                let windows = i < finest || self.search == Search::Windows;
                current.solver.scale.blocks.plan(
                    self.level,
                    coarse,
                    self.slopes,
                    windows.then_some((current.widest, current.vectors)),
                    self.crew.threads() > 1,
                );
            }
            self.nodes += current.solver.scale.blocks.nodes();
            let (l, r, disparity, confidence) = if i == finest {
                (left, right, &mut *output.disparity, &mut *output.confidence)
            } else {
                let view = |pixels| GreyView::new(pixels, width, height, width);
                match (view(&current.left), view(&current.right)) {
                    (Ok(l), Ok(r)) => (l, r, &mut current.disparity[..], &mut current.confidence[..]),
                    _ => continue,
                }
            };
            let [above, below] = &mut current.winners;
            let map = (&mut *disparity, &mut *confidence);
            let receive = move |middle: usize| {
                let cut = middle * width;
                let (upper_disparity, lower_disparity) = map.0.split_at_mut(cut);
                let (upper_confidence, lower_confidence) = map.1.split_at_mut(cut);
                let upper = move |row: EnergyRow<'_>| {
                    let pixels = row.y * width..(row.y + 1) * width;
                    above.row(row, &mut upper_disparity[pixels.clone()], &mut upper_confidence[pixels]);
                };
                let lower = move |row: EnergyRow<'_>| {
                    let pixels = row.y * width - cut..(row.y + 1) * width - cut;
                    below.row(row, &mut lower_disparity[pixels.clone()], &mut lower_confidence[pixels]);
                };
                (upper, lower)
            };
            // The coarsest scale always finishes.
            let mut always = || true;
            let go_on_here: &mut (dyn FnMut() -> bool + Send) =
                if i == 0 { &mut always } else { &mut *go_on };
            let done = current.solver.solve(l, r, &mut self.volumes, go_on_here, receive);
            if !done {
                let (coarse, times) = (&self.pyramid[i - 1], (finest + 1 - i) as u32);
                let map = Coarse { disparity: &coarse.disparity, confidence: &coarse.confidence, times };
                double(map, self.width, self.most, output.disparity, output.confidence);
                self.finish(left, output);
                return times;
            }
            if i < finest {
                current.speckle.apply(disparity);
                clear_unknown(disparity, confidence);
            }
        }
        self.finish(left, output);
        0
    }

    /// Downsamples the pair to all coarser scales.
    fn build_pyramid(&mut self, left: GreyView<'_>, right: GreyView<'_>) {
        let level = self.level;
        for i in (0..self.pyramid.len() - 1).rev() {
            let (coarse, fine) = self.pyramid.split_at_mut(i + 1);
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

/// Budget of the windows in vectors, from the number of disparities at the finest scale.
pub(super) fn budget(blocks: &Blocks, finest_disparities: usize) -> usize {
    let (width, height) = blocks.size();
    let hundredths = (finest_disparities * BUDGET_PERCENT).min(BUDGET_HUNDREDTHS);
    (width * height * hundredths / 100 / LANES).max(blocks.min_vectors())
}

/// Maximum window size of a scale whose resolution is halved `halved` times.
pub(super) fn widest(halved: usize) -> usize {
    WIDEST[halved.min(1)]
}

/// Winner and speckle parameters of a scale.
pub(super) fn choices(parameters: &MpvParameters, finest: bool) -> (WinnerParameters, SpeckleParameters) {
    if finest {
        // The confidence of the neighbourhood is tested later.
        return (WinnerParameters { min_confidence: 0, ..parameters.winner }, parameters.speckle);
    }
    // Slopes and windows are measured on the coarser maps, for which low noise matters more than bias.
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

/// Sets the confidence of unknown pixels to 0.
fn clear_unknown(disparity: &[u16], confidence: &mut [u8]) {
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
        go_on: &mut (dyn FnMut() -> bool + Send),
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
        let crew = self.crew.clone();
        Ok(crew.lead(|| self.match_scales(left, right, output, go_on)))
    }

    fn nodes(&self) -> usize {
        self.nodes
    }

    fn workspace_bytes(&self) -> usize {
        let scales: usize = self
            .pyramid
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
        self.volumes.bytes() + self.median.bytes() + self.confidence_filter.bytes() + scales
    }
}

#[cfg(test)]
mod tests;
