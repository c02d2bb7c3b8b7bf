//! Image quality monitoring: detects dark, overexposed, covered and mismatched images, and a road without
//! texture.
//!
//! Input: an image pair of 8-bit grey levels; for texture also the road's disparity in each row. Output:
//! [`ImageFaults`], debounced over frames. This is a self-check of the alarm: with such images, the absence
//! of detections does not mean that the road is free.

use crate::image::GreyView;
use crate::rig::Rig;

/// Sampling step in columns and rows, in px.
const SAMPLE_STEP: usize = 4;

/// Consecutive frames that change a result; a flash or a wiper affects a single frame.
const DEBOUNCE_FRAMES: u8 = 3;

/// Dark: 95 % of the image are below this grey level.
const MAX_DARK_LEVEL: u8 = 16;

/// Overexposed: 75 % of the image are at or above this grey level.
const MIN_BRIGHT_LEVEL: u8 = 250;

/// Covered (by a hand, a cap, fog): 90 % of the image lie within fewer grey levels than this.
const MIN_CONTRAST: u8 = 14;

/// Largest ratio of the contrasts of both images.
const MAX_CONTRAST_RATIO: f32 = 4.0;

/// Faults of an image pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageFaults {
    /// An image is too dark.
    pub dark: bool,
    /// An image is too bright.
    pub bright: bool,
    /// An image has no content.
    pub blocked: bool,
    /// The contrast of one image is much larger than that of the other.
    pub contrast_mismatch: bool,
}

/// Percentiles of the grey levels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GreyPercentiles {
    /// 5 % of the pixels are below.
    pub low: u8,
    /// 25 % of the pixels are below.
    pub quarter: u8,
    /// 95 % of the pixels are below.
    pub high: u8,
}

impl GreyPercentiles {
    /// Percentiles of an image, from one sixteenth of its pixels.
    pub fn of(image: GreyView<'_>) -> Self {
        let mut histogram = [0_u32; 256];
        let mut count = 0;
        for y in (0..image.height()).step_by(SAMPLE_STEP) {
            for &v in image.row(y).iter().step_by(SAMPLE_STEP) {
                histogram[usize::from(v)] += 1;
                count += 1;
            }
        }
        let level = |percent: u32| {
            let mut below = 0;
            let found = histogram.iter().position(|&n| {
                below += n;
                below * 100 >= count * percent
            });
            found.unwrap_or(255) as u8
        };
        Self { low: level(5), quarter: level(25), high: level(95) }
    }

    fn contrast(self) -> u8 {
        self.high - self.low
    }
}

/// A flag that changes only after several consecutive frames.
#[derive(Clone, Copy, Debug, Default)]
struct Debounced {
    verdict: bool,
    disagreeing_frames: u8,
}

impl Debounced {
    fn update(&mut self, now: bool) -> bool {
        self.disagreeing_frames = if now == self.verdict { 0 } else { self.disagreeing_frames + 1 };
        if self.disagreeing_frames >= DEBOUNCE_FRAMES {
            (self.verdict, self.disagreeing_frames) = (now, 0);
        }
        self.verdict
    }
}

/// Monitors image pairs.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImageMonitor {
    dark: Debounced,
    bright: Debounced,
    blocked: Debounced,
    contrast_mismatch: Debounced,
}

impl ImageMonitor {
    /// Updates the monitor with a pair and returns the debounced faults.
    pub fn update(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> ImageFaults {
        let percentiles = [GreyPercentiles::of(left), GreyPercentiles::of(right)];
        let any = |is: &dyn Fn(GreyPercentiles) -> bool| percentiles.iter().any(|&l| is(l));
        let dark = any(&|l| l.high < MAX_DARK_LEVEL);
        let bright = any(&|l| l.quarter >= MIN_BRIGHT_LEVEL);
        let blocked = !dark && !bright && any(&|l| l.contrast() < MIN_CONTRAST);
        let [a, b] = percentiles.map(|l| f32::from(l.contrast()).max(1.0));
        let contrast_mismatch = !dark && !bright && !blocked && (a / b).max(b / a) > MAX_CONTRAST_RATIO;
        ImageFaults {
            dark: self.dark.update(dark),
            bright: self.bright.update(bright),
            blocked: self.blocked.update(blocked),
            contrast_mismatch: self.contrast_mismatch.update(contrast_mismatch),
        }
    }
}

/// Size of the blocks whose means are compared, in px; averaging reduces noise.
const BLOCK: usize = 4;

/// Largest distance of the road that is examined, in metres.
const MAX_ROAD_DISTANCE_M: f64 = 20.0;

/// Smallest texture, in grey levels, that a matcher can use. Dry and wet asphalt, snow and night have 1.6 and
/// more.
const MIN_TEXTURE: f32 = 0.7;

/// Fewest pairs of blocks for a result.
const MIN_BLOCK_PAIRS: u32 = 60;

/// Texture of the road in the vehicle's path, in grey levels: mean difference of neighbouring blocks of 4 × 4
/// px, minus the contribution of noise. `profile_px` is the disparity of the road in each row (0 above it).
/// `None` if too little of the road is in the image.
pub fn road_texture(left: GreyView<'_>, profile_px: &[f32], rig: &Rig, path_width_m: f64) -> Option<f32> {
    let min_px = rig.disparity_px(MAX_ROAD_DISTANCE_M);
    let (mut sum, mut count) = (0.0_f32, 0_u32);
    // Histogram of absolute second differences; the noise is estimated from its median.
    let mut second_differences = [0_u32; 64];
    let rows = left.height().min(profile_px.len());
    for y in (0..rows.saturating_sub(BLOCK)).step_by(BLOCK) {
        let disparity = f64::from(profile_px[y]);
        if disparity < min_px {
            continue;
        }
        let half_px = path_width_m / 2.0 * disparity / rig.baseline_m;
        let from = (rig.cx_px - half_px).max(0.0) as usize;
        let to = ((rig.cx_px + half_px).max(0.0) as usize).min(left.width());
        let mut before: Option<f32> = None;
        let mut x = from;
        while x + BLOCK <= to {
            let total: u32 = (y..y + BLOCK)
                .map(|y| left.row(y)[x..x + BLOCK].iter().map(|&v| u32::from(v)).sum::<u32>())
                .sum();
            let mean = total as f32 / (BLOCK * BLOCK) as f32;
            if let Some(before) = before.replace(mean) {
                sum += (mean - before).abs();
                count += 1;
            }
            let [a, b, c] = [left.row(y)[x], left.row(y)[x + 1], left.row(y)[x + 2]].map(i32::from);
            second_differences[(a - 2 * b + c).unsigned_abs().min(63) as usize] += 1;
            x += BLOCK;
        }
    }
    if count < MIN_BLOCK_PAIRS {
        return None;
    }
    let half = second_differences.iter().sum::<u32>() / 2;
    let mut below = 0;
    let median = second_differences.iter().position(|&n| {
        below += n;
        below > half
    });
    // For normal noise of σ the median is 1.65 σ, and the mean difference of neighbouring blocks is 0.28 σ.
    let noise = 0.28 / 1.65 * median.unwrap_or(0) as f32;
    let mean = sum / count as f32;
    Some((mean * mean - noise * noise).max(0.0).sqrt())
}

/// Monitors the texture of the road.
#[derive(Clone, Copy, Debug, Default)]
pub struct TextureMonitor {
    low_texture: Debounced,
}

impl TextureMonitor {
    /// Updates the monitor and returns whether there is too little texture; `None` keeps the result.
    pub fn update(&mut self, texture: Option<f32>) -> bool {
        let now = texture.map_or(self.low_texture.verdict, |t| t < MIN_TEXTURE);
        self.low_texture.update(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (64, 48);

    fn image(value: impl Fn(usize, usize) -> u8) -> Vec<u8> {
        (0..SIZE.0 * SIZE.1).map(|i| value(i % SIZE.0, i / SIZE.0)).collect()
    }

    fn view(pixels: &[u8]) -> GreyView<'_> {
        GreyView::new(pixels, SIZE.0, SIZE.1, SIZE.0).expect("valid size")
    }

    fn verdict(left: &[u8], right: &[u8], frames: usize) -> ImageFaults {
        let mut check = ImageMonitor::default();
        let mut faults = ImageFaults::default();
        for _ in 0..frames {
            faults = check.update(view(left), view(right));
        }
        faults
    }

    #[test]
    fn unusable_images_are_reported_with_their_fault() {
        let road = image(|x, y| (40 + 2 * y + x) as u8);
        let night = image(|x, y| if y > 30 { (8 + x / 2) as u8 } else { 5 });
        let fine = ImageFaults::default();
        for good in [&road, &night] {
            assert_eq!(verdict(good, good, 5), fine);
        }
        let black = image(|x, _| (x % 9) as u8);
        let dazzled = image(|_, y| if y < 40 { 255 } else { 90 });
        let hand = image(|x, _| 60 + (x % 7) as u8);
        let fog = image(|x, y| 120 + ((x + y) / 5) as u8);
        for (bad, expected) in [
            (&black, ImageFaults { dark: true, ..fine }),
            (&dazzled, ImageFaults { bright: true, ..fine }),
            (&hand, ImageFaults { blocked: true, ..fine }),
            (&fog, ImageFaults { contrast_mismatch: true, ..fine }),
        ] {
            assert_eq!(verdict(bad, &road, 3), expected);
            assert_eq!(verdict(&road, bad, 3), expected, "the fault may be in either camera");
            assert_eq!(verdict(&road, bad, 2), fine, "two frames are not enough");
        }
    }

    #[test]
    fn a_road_without_texture_is_distinguished_from_noise() {
        let rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
        let profile: Vec<f32> = (0..480).map(|y| (y as f32 - 215.0).max(0.0) * 0.096).collect();
        for (seed, noise) in [(1, 1.0), (2, 3.0), (3, 6.0)] {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut road = |texture: f64| -> Vec<u8> {
                let mut grain = vec![0.0; 640 * 480];
                // Elements of several pixels, like stones and cracks.
                for _ in 0..12_000 {
                    let (x, y, v) = (random.usize(0..634), random.usize(0..476), random.f64() * 2.0 - 1.0);
                    for (dx, dy) in (0..24).map(|i| (i % 6, i / 6)) {
                        grain[(y + dy) * 640 + x + dx] += texture * v;
                    }
                }
                grain
                    .iter()
                    .map(|g| {
                        let normal = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
                        (110.0 + g + noise * normal).clamp(0.0, 255.0) as u8
                    })
                    .collect()
            };
            let texture = |pixels: &[u8]| {
                let view = GreyView::new(pixels, 640, 480, 640).expect("valid size");
                road_texture(view, &profile, &rig, 2.4).expect("enough road")
            };
            let (bare, rough) = (texture(&road(0.0)), texture(&road(6.0)));
            println!("noise {noise}: bare {bare:.2}, rough {rough:.2}");
            assert!(bare < MIN_TEXTURE && rough > 2.0 * MIN_TEXTURE, "noise {noise}: {bare} {rough}");
        }
        let view = vec![9; 640 * 480];
        let view = GreyView::new(&view, 640, 480, 640).expect("valid size");
        assert_eq!(road_texture(view, &[0.0; 480], &rig, 2.4), None);
        let mut check = TextureMonitor::default();
        let verdicts = [Some(0.1), None, Some(0.1), Some(0.1), Some(0.1), None, Some(3.0)];
        assert_eq!(verdicts.map(|t| check.update(t)), [false, false, false, false, true, true, true]);
    }

    #[test]
    fn recovery_is_debounced_like_failure() {
        let (road, black) = (image(|x, y| (40 + 2 * y + x) as u8), image(|_, _| 3));
        let mut check = ImageMonitor::default();
        for _ in 0..3 {
            check.update(view(&black), view(&black));
        }
        let after: Vec<bool> = (0..4).map(|_| check.update(view(&road), view(&road)).dark).collect();
        assert_eq!(after, [true, true, false, false]);
    }
}
