//! Candidate features, and their values on all samples quantised to one byte.

use super::threads;
use fastrand::Rng;
use perception::recognition::cascade::{Features, HaarFeature, LbpFeature, Split, WeightedRect};
use perception::recognition::integral::Integral;
use serde::{Deserialize, Serialize};

/// Number of samples processed together.
const BLOCK: usize = 32;

/// Maximum number of quantisation thresholds of a Haar feature.
const MAX_CUTS: usize = 63;

/// Number of values from which the thresholds of a Haar feature are derived.
const SURVEY_SAMPLES: usize = 512;

/// Feature type of the trees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FeatureKind {
    /// Multi-block local binary patterns.
    Lbp,
    /// Upright Haar features.
    Haar,
    /// Upright and tilted Haar features.
    HaarTilted,
}

impl FeatureKind {
    /// The type of a cascade's features.
    pub fn of(features: &Features) -> Self {
        match features {
            Features::Lbp(_) => Self::Lbp,
            Features::Haar(list) if list.iter().any(|f| f.tilted) => Self::HaarTilted,
            Features::Haar(_) => Self::Haar,
        }
    }

    /// All features of a window.
    pub fn all(self, width: u16, height: u16) -> Features {
        match self {
            Self::Lbp => Features::Lbp(all_lbp(width, height)),
            Self::Haar => Features::Haar(all_haar(width, height, false)),
            Self::HaarTilted => Features::Haar(all_haar(width, height, true)),
        }
    }
}

/// All multi-block LBP features of a window, columns outermost, in the order of OpenCV's trainer.
pub fn all_lbp(width: u16, height: u16) -> Vec<LbpFeature> {
    let mut features = Vec::new();
    for x in 0..width {
        for y in 0..height {
            for w in 1..=(width - x) / 3 {
                for h in 1..=(height - y) / 3 {
                    features.push(LbpFeature { x, y, width: w, height: h });
                }
            }
        }
    }
    features
}

/// All Haar features of a window: edges, lines, checkerboards and centre-surround, and tilted edges and lines.
pub fn all_haar(width: u16, height: u16, tilted: bool) -> Vec<HaarFeature> {
    let mut features = Vec::new();
    let rect = |x, y, width, height, weight| WeightedRect { x, y, width, height, weight };
    let none = WeightedRect::default();
    let fits = |x: u16, y: u16, w: u16, h: u16| x + w <= width && y + h <= height;
    for x in 0..width {
        for y in 0..height {
            for w in 1..=width {
                for h in 1..=height {
                    let mut push = |whole: (u16, u16), rects: [WeightedRect; 3]| {
                        if fits(x, y, whole.0, whole.1) {
                            features.push(HaarFeature { rects, tilted: false });
                        }
                    };
                    let whole = |w, h| rect(x, y, w, h, -1.0);
                    push((2 * w, h), [whole(2 * w, h), rect(x + w, y, w, h, 2.0), none]);
                    push((w, 2 * h), [whole(w, 2 * h), rect(x, y + h, w, h, 2.0), none]);
                    push((3 * w, h), [whole(3 * w, h), rect(x + w, y, w, h, 3.0), none]);
                    push((w, 3 * h), [whole(w, 3 * h), rect(x, y + h, w, h, 3.0), none]);
                    push((4 * w, h), [whole(4 * w, h), rect(x + w, y, 2 * w, h, 2.0), none]);
                    push((w, 4 * h), [whole(w, 4 * h), rect(x, y + h, w, 2 * h, 2.0), none]);
                    push((3 * w, 3 * h), [whole(3 * w, 3 * h), rect(x + w, y + h, w, h, 9.0), none]);
                    let quarters = [rect(x, y, w, h, 2.0), rect(x + w, y + h, w, h, 2.0)];
                    push((2 * w, 2 * h), [whole(2 * w, 2 * h), quarters[0], quarters[1]]);
                    if tilted {
                        // Arms of 2w and h, of w and 2h, of 3w and h, of w and 3h.
                        for (long_w, long_h, times) in [(2, 1, 2.0), (1, 2, 2.0), (3, 1, 3.0), (1, 3, 3.0)] {
                            let (arm_w, arm_h) = (long_w * w, long_h * h);
                            if arm_h > x || x + arm_w > width || y + arm_w + arm_h > height {
                                continue;
                            }
                            let part = match (long_w, long_h) {
                                (3, _) => rect(x + w, y + w, w, h, times),
                                (_, 3) => rect(x - h, y + h, w, h, times),
                                _ => rect(x, y, w, h, times),
                            };
                            let rects = [rect(x, y, arm_w, arm_h, -1.0), part, none];
                            features.push(HaarFeature { rects, tilted: true });
                        }
                    }
                }
            }
        }
    }
    features
}

/// `count` features drawn at random, in their original order; all when there are no more.
pub fn draw(features: &Features, count: usize, random: &mut Rng) -> Features {
    fn some<T: Copy>(all: &[T], count: usize, random: &mut Rng) -> Vec<T> {
        if count >= all.len() {
            return all.to_vec();
        }
        let mut left = count;
        let drawn = all.iter().enumerate().filter(|(i, _)| {
            let taken = random.usize(0..all.len() - i) < left;
            left -= usize::from(taken);
            taken
        });
        drawn.map(|(_, f)| *f).collect()
    }
    match features {
        Features::Lbp(all) => Features::Lbp(some(all, count, random)),
        Features::Haar(all) => Features::Haar(some(all, count, random)),
    }
}

/// Index of a pool's feature in the cascade, to which it is added if missing.
pub fn add(features: &mut Features, pool: &Features, index: usize) -> u32 {
    fn place<T: PartialEq + Copy>(list: &mut Vec<T>, item: T) -> u32 {
        let at = list.iter().position(|f| *f == item).unwrap_or_else(|| {
            list.push(item);
            list.len() - 1
        });
        at as u32
    }
    match (features, pool) {
        (Features::Lbp(list), Features::Lbp(pool)) => place(list, pool[index]),
        (Features::Haar(list), Features::Haar(pool)) => place(list, pool[index]),
        // A cascade and its pools have the same type.
        _ => 0,
    }
}

/// Integral images of one sample.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    integral: Integral,
    inverse: f32,
    /// Whether a detector with Haar features can evaluate it.
    pub is_valid: bool,
}

impl Sums {
    /// Integral images of a window of `size` pixels, as needed for these features.
    pub fn of(window: &[u8], size: (u16, u16), kind: FeatureKind) -> Self {
        let mut sums = Self::default();
        sums.fill(window, size, kind);
        sums
    }

    /// The same, reusing the allocated memory.
    pub fn fill(&mut self, window: &[u8], (width, height): (u16, u16), kind: FeatureKind) {
        self.integral.fill(window, width.into());
        (self.inverse, self.is_valid) = (1.0, true);
        if kind == FeatureKind::HaarTilted {
            self.integral.fill_tilted(window, width.into());
        }
        if kind != FeatureKind::Lbp {
            let contrast = self.integral.contrast(width, height, 0, 0);
            (self.inverse, self.is_valid) = (contrast.inverse, contrast.sound);
        }
    }

    /// Whether a split on feature `feature` sends the sample to the left.
    pub fn goes_left(&self, features: &Features, feature: usize, split: &Split) -> bool {
        match (features, split) {
            (Features::Lbp(features), split) => split.has(features[feature].code(&self.integral, 0, 0)),
            (Features::Haar(features), Split::Threshold(threshold)) => {
                features[feature].value(&self.integral, 0, 0, self.inverse) < *threshold
            }
            (Features::Haar(_), Split::Subset(_)) => false,
        }
    }

    /// The integral images.
    pub fn integral(&self) -> &Integral {
        &self.integral
    }
}

/// Values of every feature on every sample, as one byte: the code of an LBP feature, or the number of thresholds
/// that a Haar value reaches.
#[derive(Debug)]
pub struct Codes {
    samples: usize,
    rows: Vec<Vec<u8>>,
    /// Thresholds of Haar features, ascending.
    cuts: Vec<Vec<f32>>,
}

impl Codes {
    /// Codes of `features` on `samples`.
    pub fn new(features: &Features, samples: &[Sums], threads: usize) -> Self {
        let mut codes = Self { samples: samples.len(), rows: Vec::new(), cuts: Vec::new() };
        match features {
            Features::Lbp(features) => {
                let blocks: Vec<LaneSums> = samples.chunks(BLOCK).map(LaneSums::new).collect();
                codes.rows =
                    chunked(threads, features.len(), |i| lbp_row(&features[i], &blocks, samples.len()));
            }
            Features::Haar(features) => {
                let rows = chunked(threads, features.len(), |i| haar_row(&features[i], samples));
                (codes.rows, codes.cuts) = rows.into_iter().unzip();
            }
        }
        codes
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        self.rows.len()
    }

    /// Codes of one feature.
    pub fn row(&self, feature: usize) -> &[u8] {
        &self.rows[feature]
    }

    /// Whether the codes are ordered like the values.
    pub fn ordered(&self) -> bool {
        !self.cuts.is_empty()
    }

    /// The split that sends the codes marked in `left` to the left; for ordered codes, the lower ones.
    pub fn split(&self, feature: usize, left: &[bool; 256]) -> Split {
        if self.ordered() {
            // A value below threshold k has a code of at most k.
            let last = left.iter().rposition(|&l| l).unwrap_or(0);
            return Split::Threshold(self.cuts[feature].get(last).copied().unwrap_or(f32::MAX));
        }
        let mut words = [0_u32; 8];
        for (code, _) in left.iter().enumerate().filter(|(_, l)| **l) {
            words[code >> 5] |= 1 << (code & 31);
        }
        Split::Subset(words)
    }
}

/// Runs `work` on indices, in chunks large enough to be worth a thread.
fn chunked<R: Send>(threads: usize, count: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
    const RUN: usize = 64;
    let runs = threads::map(threads, count.div_ceil(RUN), |run| {
        (run * RUN..count.min((run + 1) * RUN)).map(&work).collect::<Vec<R>>()
    });
    runs.into_iter().flatten().collect()
}

/// Integral images of [`BLOCK`] samples, interleaved.
struct LaneSums {
    entries: Vec<[i32; BLOCK]>,
    stride: usize,
}

impl LaneSums {
    fn new(samples: &[Sums]) -> Self {
        let (stride, rows) = samples.first().map_or((0, 0), |s| s.integral.size());
        let mut entries = vec![[0; BLOCK]; stride * rows];
        for (lane, sample) in samples.iter().enumerate() {
            for y in 0..rows {
                for x in 0..stride {
                    entries[y * stride + x][lane] = sample.integral.sum_at(x, y) as i32;
                }
            }
        }
        Self { entries, stride }
    }
}

fn lbp_row(feature: &LbpFeature, blocks: &[LaneSums], samples: usize) -> Vec<u8> {
    let mut row = Vec::with_capacity(samples + BLOCK);
    let (w, h) = (usize::from(feature.width), usize::from(feature.height));
    for block in blocks {
        let start = usize::from(feature.y) * block.stride + usize::from(feature.x);
        let corner = |i: usize, j: usize| &block.entries[start + j * h * block.stride + i * w];
        let sum = |i: usize, j: usize| {
            let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i, j + 1), corner(i + 1, j + 1));
            let mut sum = [0_i32; BLOCK];
            for lane in 0..BLOCK {
                sum[lane] = d[lane] - c[lane] - b[lane] + a[lane];
            }
            sum
        };
        let centre = sum(1, 1);
        let mut code = [0_i32; BLOCK];
        for (i, j) in [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)] {
            let outer = sum(i, j);
            for lane in 0..BLOCK {
                code[lane] = code[lane] << 1 | i32::from(outer[lane] >= centre[lane]);
            }
        }
        row.extend(code.map(|c| c as u8));
    }
    row.truncate(samples);
    row
}

fn haar_row(feature: &HaarFeature, samples: &[Sums]) -> (Vec<u8>, Vec<f32>) {
    let values: Vec<f32> = samples.iter().map(|s| feature.value(&s.integral, 0, 0, s.inverse)).collect();
    let mut survey: Vec<f32> =
        values.iter().step_by(values.len().div_ceil(SURVEY_SAMPLES).max(1)).copied().collect();
    survey.sort_unstable_by(f32::total_cmp);
    survey.dedup();
    // Midway between neighbouring values, at equal quantiles.
    let mut ranks: Vec<usize> = (1..=MAX_CUTS).map(|k| (k * survey.len() / (MAX_CUTS + 1)).max(1)).collect();
    ranks.dedup();
    let ranks = ranks.into_iter().filter(|&rank| rank < survey.len());
    let cuts: Vec<f32> =
        ranks.map(|rank| survey[rank - 1] + (survey[rank] - survey[rank - 1]) / 2.0).collect();
    let codes = values.iter().map(|v| cuts.partition_point(|cut| cut <= v) as u8).collect();
    (codes, cuts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(count: usize, haar: bool) -> Vec<Sums> {
        let mut random = Rng::with_seed(6);
        (0..count)
            .map(|_| {
                let window: Vec<u8> = (0..24 * 24).map(|_| random.u8(..)).collect();
                Sums::of(&window, (24, 24), if haar { FeatureKind::HaarTilted } else { FeatureKind::Lbp })
            })
            .collect()
    }

    #[test]
    fn a_24_pixel_window_has_the_known_number_of_features() {
        assert_eq!(all_lbp(24, 24).len(), 8464);
        let count = |columns: usize, rows: usize| -> usize {
            let along = |parts: usize| (1..=24 / parts).map(|side| 25 - parts * side).sum::<usize>();
            along(columns) * along(rows)
        };
        // Edges, lines of three and checkerboards: the number given by Viola and Jones.
        let classic = count(2, 1) + count(1, 2) + count(3, 1) + count(1, 3) + count(2, 2);
        assert_eq!(classic, 162_336);
        let upright = all_haar(24, 24, false).len();
        assert_eq!(upright, classic + count(4, 1) + count(1, 4) + count(3, 3));
        assert!(all_haar(24, 24, true).iter().any(|f| f.tilted));
    }

    #[test]
    fn codes_are_those_of_the_detector() {
        for haar in [false, true] {
            let samples = samples(45, haar);
            let features =
                if haar { Features::Haar(all_haar(24, 24, true)) } else { Features::Lbp(all_lbp(24, 24)) };
            let drawn = draw(&features, 50, &mut Rng::with_seed(7));
            assert_eq!(drawn.len(), 50);
            let codes = Codes::new(&drawn, &samples, 2);
            for feature in 0..50 {
                let mut left = [false; 256];
                let (low, high) = (codes.row(feature).iter().min(), codes.row(feature).iter().max());
                let half = (low.copied().unwrap_or(0) / 2 + high.copied().unwrap_or(0) / 2).max(1);
                left[..usize::from(half)].fill(true);
                let split = codes.split(feature, &left);
                for (sample, &code) in samples.iter().zip(codes.row(feature)) {
                    assert_eq!(sample.goes_left(&drawn, feature, &split), code < half, "{haar} {feature}");
                }
            }
        }
    }
}
