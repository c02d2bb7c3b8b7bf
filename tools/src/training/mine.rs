//! Mining of negative windows: from random candidates, those that a cascade accepts.

use super::augment::{Part, Sampling, Variation, fade, relight, vary, window};
use super::features::{FeatureKind, Sums};
use super::pictures::SourcePicture;
use super::threads;
use fastrand::Rng;
use perception::recognition::cascade::Cascade;

/// Number of candidates that a thread tries in one go.
const RUN: usize = 2048;

/// Maximum number of candidates per requested window.
const MAX_TRIES_PER_WINDOW: usize = 200;

/// Images up to this many windows wide and high are patches: each is also tried as a whole.
const MAX_PATCH_WINDOWS: usize = 4;

/// Result of mining.
#[derive(Debug)]
pub struct Mined {
    /// Windows that the cascade accepts.
    pub windows: Vec<Vec<u8>>,
    /// Number of candidates tried.
    pub tried: usize,
}

impl Mined {
    /// Share of the candidates that the cascade accepts.
    pub fn acceptance(&self) -> f64 {
        self.windows.len() as f64 / self.tried.max(1) as f64
    }
}

/// Draws windows from images, reproducibly for a seed.
#[derive(Debug)]
pub struct Miner<'a> {
    pictures: &'a [SourcePicture],
    /// Cumulative weights of the images.
    shares: Vec<f64>,
    window: (usize, usize),
    patches: Vec<usize>,
    variation: Variation,
    seed: u64,
}

impl<'a> Miner<'a> {
    /// A miner for windows of `window` pixels; smaller images are skipped.
    pub fn new(
        pictures: &'a [SourcePicture],
        window: (usize, usize),
        variation: Variation,
        seed: u64,
    ) -> Self {
        let mut sum = 0.0;
        let mut shares = Vec::with_capacity(pictures.len());
        let mut patches = Vec::new();
        for (i, picture) in pictures.iter().enumerate() {
            let (w, h) = (picture.grey.width(), picture.grey.height());
            if w >= window.0 && h >= window.1 {
                // A large image is drawn more often than a patch.
                sum += ((w * h) as f64).sqrt();
                if w <= MAX_PATCH_WINDOWS * window.0 && h <= MAX_PATCH_WINDOWS * window.1 {
                    patches.push(i);
                }
            }
            shares.push(sum);
        }
        Self { pictures, shares, window, patches, variation, seed }
    }

    /// Whether no image is large enough.
    pub fn is_empty(&self) -> bool {
        self.shares.last().is_none_or(|&s| s <= 0.0)
    }

    /// Indices of the patches, which are small enough to be tried as a whole.
    pub fn patches(&self) -> &[usize] {
        &self.patches
    }

    /// Candidate `index` of a round: first the patches as a whole, then random parts, a quarter of them combined from
    /// two: a combination of two negatives is a negative.
    fn candidate(&self, round: u64, index: usize, out: &mut Vec<u8>) {
        if let Some(&patch) = self.patches.get(index) {
            let view = self.pictures[patch].grey.view();
            return window(view, Part::whole(view), Sampling::Area, self.window, out);
        }
        let mut random = Rng::with_seed(self.seed ^ (round << 40) ^ index as u64);
        self.part(&mut random, out);
        if self.variation.light > 0.0 && random.u8(0..4) == 0 {
            let mut other = Vec::with_capacity(out.len());
            self.part(&mut random, &mut other);
            let (width, height) = self.window;
            let (row, column) = (random.usize(1..height), random.usize(1..width));
            let upright = random.bool();
            for (i, (v, &w)) in out.iter_mut().zip(&other).enumerate() {
                if if upright { i % width >= column } else { i / width >= row } {
                    *v = w;
                }
            }
        }
        fade(&self.variation, &mut random, out);
    }

    /// A random part of a random image.
    fn part(&self, random: &mut Rng, out: &mut Vec<u8>) {
        let (width, height) = self.window;
        let drawn = random.f64() * self.shares.last().copied().unwrap_or(0.0);
        let picture = self.shares.partition_point(|&s| s <= drawn).min(self.pictures.len() - 1);
        let view = self.pictures[picture].grey.view();
        if self.patches.binary_search(&picture).is_ok() && random.bool() {
            return vary(view, Part::whole(view), &self.variation, random, self.window, out);
        }
        let most = (view.width() as f64 / width as f64).min(view.height() as f64 / height as f64);
        let scale = most.powf(random.f64());
        let (w, h) = (scale * width as f64, scale * height as f64);
        let part = Part {
            x: random.f64() * (view.width() as f64 - w),
            y: random.f64() * (view.height() as f64 - h),
            width: w,
            height: h,
        };
        let sampling = if random.bool() { Sampling::Area } else { Sampling::Bilinear };
        window(view, part, sampling, self.window, out);
        if random.bool() {
            for row in out.chunks_exact_mut(width) {
                row.reverse();
            }
        }
        relight(&self.variation, random, width, out);
    }

    /// The first `count` windows of a round that pass all stages of `cascade`; fewer when they are too rare.
    pub fn mine(&self, cascade: &Cascade, round: u64, count: usize, threads: usize) -> Mined {
        let kind = FeatureKind::of(&cascade.features);
        let mut mined = Mined { windows: Vec::new(), tried: 0 };
        if self.is_empty() {
            return mined;
        }
        let most = count * MAX_TRIES_PER_WINDOW + self.patches.len();
        while mined.windows.len() < count && mined.tried < most {
            // The amount of work does not depend on the number of threads, so that the result is the same.
            let runs = threads::map(threads, 8, |run| {
                let mut found = Vec::new();
                let (mut out, mut sums) = (Vec::new(), Sums::default());
                let first = mined.tried + run * RUN;
                for index in first..first + RUN {
                    self.candidate(round, index, &mut out);
                    sums.fill(&out, (cascade.width, cascade.height), kind);
                    if sums.is_valid
                        && cascade.stages_passed(sums.integral(), 0, 0) == Some(cascade.stages.len())
                    {
                        found.push((index, out.clone()));
                    }
                }
                found
            });
            let end = mined.tried + 8 * RUN;
            mined.tried = end;
            for (index, window) in runs.into_iter().flatten() {
                if mined.windows.len() < count {
                    mined.windows.push(window);
                    if mined.windows.len() == count {
                        mined.tried = index + 1;
                    }
                }
            }
        }
        mined
    }
}
