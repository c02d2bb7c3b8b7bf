//! How the right picture differs from the left one where both should show the road.
//!
//! The right picture is moved onto the left one by the road's disparity. What lies on the road then agrees,
//! whatever is painted on it. What stands on it is off by δ px, its disparity less the road's: with the
//! horizontal gradient g and the difference r of the two, r ≈ δ·g, and over a window δ = Σ g·r / Σ g². That is
//! finer than a disparity map, whose windows and paths smear what is a few pixels large into the road.

use crate::image::GreyView;
use crate::rig::Rig;
use crate::road::tilt::Tilt;
use crate::simd::rounding::nearest;
use crate::simd::{Level, Simd, kernel};

/// Greatest gradient and difference that are counted, in half grey levels: sums of a window then fit.
const MOST: f32 = 254.0;
/// Columns at either border of a row that are left out: an interpolation and a gradient need them.
const BORDER: f32 = 3.0;
/// Rows and columns between the samples of the gain.
const GAIN_STEP: (usize, usize) = (4, 8);
/// One picture is at most so many times as bright as the other.
const MAX_GAIN: f32 = 2.0;

/// Where the road lies in both pictures.
#[derive(Clone, Copy, Debug)]
pub struct Ground<'a> {
    /// Disparity of the road in each row, in px.
    pub profile_px: &'a [f32],
    /// How it lies across.
    pub tilt: Tilt,
    /// The cameras.
    pub rig: Rig,
}

impl Ground<'_> {
    /// Disparity of the road at a pixel, in px.
    pub fn disparity_px(&self, x: f64, y: usize) -> f64 {
        f64::from(self.profile_px[y]) + self.tilt.roll * (x - self.tilt.cx_px) + self.tilt.offset_px
    }

    /// Metres to the right of the camera, on the road.
    pub fn lateral_m(&self, x: f64, y: usize) -> f64 {
        (x - self.rig.cx_px) * self.rig.baseline_m / f64::from(self.profile_px[y]).max(1e-3)
    }

    /// Disparity that the next row below adds, in px.
    pub fn slope(&self, y: usize) -> f64 {
        let (above, below) = (y.saturating_sub(2), (y + 2).min(self.profile_px.len() - 1));
        f64::from(self.profile_px[below] - self.profile_px[above]) / (below - above).max(1) as f64
    }

    /// Columns of a row that lie within `half_m` of the camera and in both pictures.
    fn columns(&self, y: usize, half_m: f64, width: usize) -> std::ops::Range<usize> {
        let road = f64::from(self.profile_px[y]);
        let half = half_m * road / self.rig.baseline_m;
        let hidden = self.disparity_px(0.0, y).max(0.0) / (1.0 - self.tilt.roll) + f64::from(BORDER);
        let from = (self.rig.cx_px - half).max(hidden).ceil().max(f64::from(BORDER)) as usize;
        let from = from.min(width);
        let to = (self.rig.cx_px + half).min(width as f64 - f64::from(BORDER)).max(0.0) as usize;
        from..to.max(from)
    }
}

/// Sums over a window, in squared grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Σ g².
    pub gradient: f64,
    /// Σ g·r.
    pub product: f64,
    /// Σ r².
    pub difference: f64,
    /// Pixels.
    pub count: f64,
}

impl Sums {
    /// What is in these but not in others.
    pub fn without(self, other: Sums) -> Sums {
        Sums {
            gradient: self.gradient - other.gradient,
            product: self.product - other.product,
            difference: self.difference - other.difference,
            count: self.count - other.count,
        }
    }

    /// The same where the road's disparity is greater by `offset_px`.
    pub fn beyond(self, offset_px: f64) -> Sums {
        Sums { product: self.product - offset_px * self.gradient, ..self }
    }

    /// δ in px, drawn to 0 where there is less than what tells it to `prior_px` at a noise of `sigma`.
    pub fn offset_px(&self, sigma: f64, prior_px: f64) -> f64 {
        self.product / (self.gradient + (sigma / prior_px).powi(2))
    }

    /// δ in standard deviations, for pixels with a noise of `sigma`.
    pub fn prominence(&self, sigma: f64) -> f64 {
        self.product / (self.gradient.sqrt() + 1e-3) / sigma
    }
}

/// A window: left, top, and right, bottom, which are no longer in it. It may reach outside the picture.
pub type Window = [i32; 4];

/// The differences of one pair, with memory allocated once.
#[derive(Debug)]
pub struct Residual {
    width: usize,
    height: usize,
    /// Rows from this one on are known.
    first: usize,
    /// g², g·r, r² and pixels, summed over everything above and to the left, modulo 2³².
    sums: Vec<[u32; 4]>,
    /// Columns of each row of sums that are kept: nothing lies left or right of them, there and above.
    kept: Vec<[u32; 2]>,
    /// A row of the right picture, moved.
    moved: Vec<f32>,
    gain: f32,
    level: Level,
}

impl Residual {
    /// A workspace for pictures of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            first: height,
            sums: vec![[0; 4]; (width + 1) * (height + 1)],
            kept: vec![[0; 2]; height + 1],
            moved: vec![0.0; width],
            gain: 1.0,
            level: Level::best(),
        }
    }

    /// What the right picture is multiplied with to be as bright as the left.
    pub fn gain(&self) -> f32 {
        self.gain
    }

    /// Compares a pair on the road from row `first` on, within `half_m` to either side of the camera.
    ///
    /// # Panics
    /// When the pictures have another size than the workspace.
    pub fn fill(&mut self, [left, right]: [GreyView<'_>; 2], ground: &Ground<'_>, first: usize, half_m: f64) {
        let size = (self.width, self.height);
        assert!((left.width(), left.height()) == size && (right.width(), right.height()) == size);
        self.first = first.min(self.height);
        let rows = self.first..self.height;
        let mut brightness = [1_u64; 2];
        for y in rows.clone().step_by(GAIN_STEP.0) {
            for x in ground.columns(y, half_m, self.width).step_by(GAIN_STEP.1) {
                let there = (x as f64 - ground.disparity_px(x as f64, y)).clamp(0.0, (self.width - 1) as f64);
                brightness[0] += u64::from(left.row(y)[x]);
                brightness[1] += u64::from(right.row(y)[there as usize]);
            }
        }
        let gain = brightness[0] as f32 / brightness[1] as f32;
        self.gain = gain.clamp(1.0 / MAX_GAIN, MAX_GAIN);
        let pitch = self.width + 1;
        // Nothing lies above the first row: one column, that of its corridor, is enough.
        let [mut from, mut to] =
            [ground.columns(self.first.min(self.height - 1), half_m, self.width).start; 2];
        self.sums[self.first * pitch + from] = [0; 4];
        self.kept[self.first] = [from as u32; 2];
        for y in rows {
            let columns = ground.columns(y, half_m, self.width);
            let (above, here) = self.sums[y * pitch..].split_at_mut(pitch);
            if columns.is_empty() {
                here[from..=to].copy_from_slice(&above[from..=to]);
                self.kept[y + 1] = self.kept[y];
                continue;
            }
            let (first, last) = (columns.start, columns.end);
            // What was not kept so far, for there is nothing there.
            if first < from {
                above[first..from].fill([0; 4]);
            }
            if last > to {
                let whole = above[to];
                above[to + 1..=last].fill(whole);
            }
            (from, to) = (from.min(first), to.max(last));
            self.kept[y + 1] = [from as u32, to as u32];
            let start = first as f64;
            let line = Line {
                at: (start - ground.disparity_px(start, y)) as f32,
                step: (1.0 - ground.tilt.roll) as f32,
                gain: self.gain,
            };
            here[from..=first].copy_from_slice(&above[from..=first]);
            let moved = &mut self.moved[columns.clone()];
            let row = &left.row(y)[columns];
            let sums = (&above[first..=last], &mut here[first..=last]);
            compare(self.level, right.row(y), line, row, moved, sums.0, sums.1);
            let sum = minus(here[last], above[last]);
            for (here, above) in here[last + 1..=to].iter_mut().zip(&above[last + 1..=to]) {
                *here = plus(*above, sum);
            }
        }
    }

    /// Sums over a window.
    pub fn sums(&self, [left, top, right, bottom]: Window) -> Sums {
        self.band(top, bottom).sums(left, right)
    }

    /// The rows from `top` to before `bottom`, in which many windows are asked for.
    pub fn band(&self, top: i32, bottom: i32) -> Band<'_> {
        let edge = |y: i32| {
            let y = y.clamp(self.first as i32, self.height as i32) as usize;
            let [from, to] = self.kept[y];
            Edge {
                from: from as i32,
                to: to as i32,
                sums: &self.sums[y * (self.width + 1)..][..self.width + 1],
            }
        };
        Band { top: edge(top), bottom: edge(bottom) }
    }
}

/// Sums over everything above a row of pixels, by column.
#[derive(Clone, Copy, Debug)]
struct Edge<'a> {
    from: i32,
    to: i32,
    sums: &'a [[u32; 4]],
}

impl Edge<'_> {
    #[inline(always)]
    fn at(&self, x: i32) -> [u32; 4] {
        self.sums[x.clamp(self.from, self.to) as usize]
    }
}

/// Some rows of the differences.
#[derive(Clone, Copy, Debug)]
pub struct Band<'a> {
    top: Edge<'a>,
    bottom: Edge<'a>,
}

impl Band<'_> {
    /// Sums over its columns from `left` to before `right`.
    #[inline]
    pub fn sums(&self, left: i32, right: i32) -> Sums {
        let [gradient, product, difference, count] = self.add_up(left, right);
        Sums {
            gradient: 0.25 * f64::from(gradient),
            product: 0.25 * f64::from(product as i32),
            difference: 0.25 * f64::from(difference),
            count: f64::from(count),
        }
    }

    /// Whether they may be as prominent as `least` at a noise of 1, told more quickly.
    #[inline]
    pub fn may_be_prominent(&self, left: i32, right: i32, least: f64) -> bool {
        let [gradient, product, ..] = self.add_up(left, right);
        let product = f64::from(product as i32);
        // Both in quarters.
        product * product > 4.0 * least * least * f64::from(gradient)
    }

    #[inline(always)]
    fn add_up(&self, left: i32, right: i32) -> [u32; 4] {
        minus(
            minus(self.bottom.at(right), self.top.at(right)),
            minus(self.bottom.at(left), self.top.at(left)),
        )
    }
}

fn plus(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    std::array::from_fn(|k| a[k].wrapping_add(b[k]))
}

fn minus(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    std::array::from_fn(|k| a[k].wrapping_sub(b[k]))
}

/// Where the pixels of a row are in the right picture: the first column, what each adds, and the gain.
#[derive(Clone, Copy, Debug)]
struct Line {
    at: f32,
    step: f32,
    gain: f32,
}

kernel! {
    /// Moves a row of the right picture to where the left one (`row`) shows the same road, and adds g², g·r, r²
    /// and pixels to what lies above and to the left: `above` and `here` begin a column before the row.
    fn compare(
        right: &[u8],
        line: Line,
        row: &[u8],
        moved: &mut [f32],
        above: &[[u32; 4]],
        here: &mut [[u32; 4]],
    ) = compare_row
}

/// Columns that are moved at once.
const BLOCK: usize = 32;

#[inline(always)]
fn compare_row<S: Simd>(
    _: S,
    right: &[u8],
    line: Line,
    row: &[u8],
    moved: &mut [f32],
    above: &[[u32; 4]],
    here: &mut [[u32; 4]],
) {
    // i32 first: not every level can turn usize into floats.
    let place = |k: usize| line.at + line.step * (k as i32) as f32;
    for (block, moved) in moved.chunks_mut(BLOCK).enumerate() {
        let (from, to) = (block * BLOCK, block * BLOCK + moved.len());
        let whole = place(from).floor();
        let last = place(to - 1) - (to - 1 - from) as f32 - whole;
        let taps = usize::try_from(whole as isize - 1).ok().and_then(|i| right.get(i..i + moved.len() + 3));
        match taps {
            // All of them lie between the same neighbours.
            Some(taps) if (0.0..1.0).contains(&last) => {
                for (k, (moved, taps)) in moved.iter_mut().zip(taps.windows(4)).enumerate() {
                    let t = place(from + k) - (whole + (k as i32) as f32);
                    *moved = line.gain * cubic([0, 1, 2, 3].map(|i| f32::from(taps[i])), t);
                }
            }
            _ => {
                for (k, moved) in moved.iter_mut().enumerate() {
                    *moved = line.gain * sample(right, place(from + k));
                }
            }
        }
    }
    let mut sum = [0_u32; 4];
    let (above, here) = (&above[1..], &mut here[1..]);
    if let (Some(first), Some(above)) = (here.first_mut(), above.first()) {
        *first = *above;
    }
    let inner = row.len().saturating_sub(2);
    let blocks = above[1..][..inner].chunks(BLOCK).zip(here[1..][..inner].chunks_mut(BLOCK));
    for (block, (above, here)) in blocks.enumerate() {
        // Products first, many at once; adding up is one after the other.
        let mut terms = [[0_i32; 4]; BLOCK];
        let from = block * BLOCK;
        let (row, moved) = (&row[from..][..above.len() + 2], &moved[from..][..above.len() + 2]);
        for ((row, moved), term) in row.windows(3).zip(moved.windows(3)).zip(&mut terms) {
            let grey = |i: usize| f32::from(row[i]);
            let gradient = 0.5 * (grey(2) - grey(0) + moved[2] - moved[0]);
            let difference = 2.0 * (moved[1] - grey(1));
            // Written so that NaN is the least.
            let whole = |v: f32| {
                let v = if v > -MOST { v } else { -MOST };
                nearest(if v < MOST { v } else { MOST })
            };
            let (g, r) = (whole(gradient), whole(difference));
            *term = [g * g, g * r, r * r, 1];
        }
        for ((term, above), here) in terms.iter().zip(above).zip(here) {
            sum = plus(sum, term.map(|v| v as u32));
            *here = plus(*above, sum);
        }
    }
    if row.len() > 1 {
        here[row.len() - 1] = plus(above[row.len() - 1], sum);
    }
}

/// Grey between the pixels of a row (Catmull and Rom's cubic: a linear one would blur, and r would show
/// it); the row's ends go on.
pub fn sample(row: &[u8], at: f32) -> f32 {
    let last = row.len() as isize - 1;
    let whole = at.floor();
    let t = at - whole;
    let i = whole as isize;
    let [a, b, c, d] = match usize::try_from(i - 1).ok().and_then(|i| row.get(i..i + 4)) {
        Some(&[a, b, c, d]) => [a, b, c, d],
        _ => [-1, 0, 1, 2].map(|k| row[(i + k).clamp(0, last) as usize]),
    }
    .map(f32::from);
    cubic([a, b, c, d], t)
}

#[inline(always)]
fn cubic([a, b, c, d]: [f32; 4], t: f32) -> f32 {
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (64, 40);
    const RIG: Rig = Rig { focal_px: 100.0, baseline_m: 0.2, cx_px: 30.0, cy_px: 0.0 };

    fn view(data: &[u8]) -> GreyView<'_> {
        GreyView::new(data, SIZE.0, SIZE.1, SIZE.0).unwrap()
    }

    fn noise(seed: u64) -> Vec<u8> {
        let mut random = fastrand::Rng::with_seed(seed);
        (0..SIZE.0 * SIZE.1).map(|_| random.u8(..)).collect()
    }

    #[test]
    fn samples_between_pixels_follow_a_parabola_and_never_leave_the_row() {
        let row: Vec<u8> = (0..12).map(|x| (x * x + 3) as u8).collect();
        for at in [1.0, 1.5, 4.25, 8.9_f32] {
            assert!((sample(&row, at) - (at * at + 3.0)).abs() < 1e-4, "{at}");
        }
        for at in [-1e9, -0.5, 11.5, 1e9, f32::NAN] {
            let value = sample(&row, at);
            assert!(value.is_nan() || value.abs() < 1e30, "{at}: {value}");
        }
    }

    #[test]
    fn sums_of_windows_equal_adding_up() {
        add_up(|y| 0.2 * y as f32);
        // The corridor moves aside, to where nothing was before, and back.
        add_up(|y| if (20..30).contains(&y) { 50.0 } else { 4.0 + (y / 30) as f32 });
    }

    fn add_up(road_px: impl Fn(usize) -> f32) {
        let (left, right) = (noise(1), noise(2));
        let profile: Vec<f32> = (0..SIZE.1).map(road_px).collect();
        let tilt = Tilt { roll: 0.01, offset_px: 0.1, cx_px: 30.0 };
        let ground = Ground { profile_px: &profile, tilt, rig: RIG };
        let mut residual = Residual::new(SIZE.0, SIZE.1);
        // Twice: nothing of the pair before is left.
        residual.fill([view(&right), view(&left)], &ground, 3, 5.0);
        residual.fill([view(&left), view(&right)], &ground, 10, 0.9);
        let moved = |x: usize, y: usize| {
            let at = x as f64 - ground.disparity_px(x as f64, y);
            residual.gain() * sample(view(&right).row(y), at as f32)
        };
        for window in [[20, 12, 40, 30], [0, 0, 64, 40], [-5, 25, 33, 60], [31, 33, 32, 34], [9, 9, 9, 9]] {
            let mut sums = Sums::default();
            for y in window[1].max(10)..window[3].min(SIZE.1 as i32) {
                let columns = ground.columns(y as usize, 0.9, SIZE.0);
                for x in window[0].max(0) as usize..window[2].min(SIZE.0 as i32) as usize {
                    if x > columns.start && x + 1 < columns.end {
                        let row = view(&left).row(y as usize);
                        let grey = |x: usize| f32::from(row[x]);
                        let next = [x + 1, x - 1].map(|x| grey(x) + moved(x, y as usize));
                        let half = |v: f32| f64::from((2.0 * v).round_ties_even().clamp(-254.0, 254.0)) / 2.0;
                        let (g, r) = (half((next[0] - next[1]) / 4.0), half(moved(x, y as usize) - grey(x)));
                        sums.gradient += g * g;
                        sums.product += g * r;
                        sums.difference += r * r;
                        sums.count += 1.0;
                    }
                }
            }
            let given = residual.sums(window);
            assert_eq!(given.count, sums.count);
            // An interpolated grey may fall to either side of a half.
            let near = |a: f64, b: f64| (a - b).abs() <= 130.0 + 1e-3 * b.abs();
            assert!(near(given.gradient, sums.gradient), "{given:?} {sums:?}");
            assert!(near(given.product, sums.product), "{given:?} {sums:?}");
            assert!(near(given.difference, sums.difference), "{given:?} {sums:?}");
        }
        assert!(residual.sums([0, 0, 64, 40]).count > 500.0);
    }

    #[test]
    fn all_levels_give_the_same_sums() {
        let (left, right) = (noise(5), noise(6));
        let profile: Vec<f32> = (0..SIZE.1).map(|y| 0.2 * y as f32 - 1.0).collect();
        for roll in [0.0, 0.02, -0.05] {
            let tilt = Tilt { roll, offset_px: 0.3, cx_px: 30.0 };
            let ground = Ground { profile_px: &profile, tilt, rig: RIG };
            let all: Vec<_> = Level::available()
                .into_iter()
                .map(|level| {
                    let mut residual = Residual { level, ..Residual::new(SIZE.0, SIZE.1) };
                    residual.fill([view(&left), view(&right)], &ground, 2, 5.0);
                    residual.sums
                })
                .collect();
            assert!(all.iter().all(|sums| *sums == all[0]), "roll {roll}");
            assert!(all[0].iter().any(|sum| sum[0] > 0));
        }
    }

    #[test]
    fn an_offset_is_measured_to_a_fraction_of_a_pixel() {
        // Both pictures show one wave; the right one is darker, and the road 0.25 px nearer than it is taken for.
        let wave = |x: f64| 120.0 + 60.0 * (0.7 * x).sin();
        let profile = [4.0_f32; SIZE.1];
        let pictures = [0.0, 4.25].map(|d| {
            let gain = if d > 0.0 { 0.9 } else { 1.0 };
            let grey = |i: usize| (gain * wave((i % SIZE.0) as f64 + d)).round() as u8;
            (0..SIZE.0 * SIZE.1).map(grey).collect::<Vec<u8>>()
        });
        let ground = Ground { profile_px: &profile, tilt: Tilt::default(), rig: RIG };
        let mut residual = Residual::new(SIZE.0, SIZE.1);
        residual.fill([view(&pictures[0]), view(&pictures[1])], &ground, 0, 10.0);
        let sums = residual.sums([10, 5, 50, 30]);
        assert!((sums.offset_px(1.0, 1.0) - 0.25).abs() < 0.03, "{sums:?}");
        assert!(sums.beyond(0.25).offset_px(1.0, 1.0).abs() < 0.03);
        // The two cover other parts of the wave.
        assert!((residual.gain() - 1.0 / 0.9).abs() < 0.05, "{}", residual.gain());
    }

    #[test]
    fn what_is_prominent_always_may_be() {
        let (left, right) = (noise(3), noise(4));
        let profile: Vec<f32> = (0..SIZE.1).map(|y| 0.2 * y as f32).collect();
        let ground = Ground { profile_px: &profile, tilt: Tilt::default(), rig: RIG };
        let mut residual = Residual::new(SIZE.0, SIZE.1);
        residual.fill([view(&left), view(&right)], &ground, 5, 5.0);
        let mut random = fastrand::Rng::with_seed(1);
        let (mut prominent, mut quickly) = (0, 0);
        for _ in 0..4000 {
            let [x, y] = [random.i32(-5..60), random.i32(0..38)];
            let (right, bottom) = (x + random.i32(1..12), y + random.i32(1..12));
            let is = residual.sums([x, y, right, bottom]).prominence(1.0).abs() >= 30.0;
            let may = residual.band(y, bottom).may_be_prominent(x, right, 30.0);
            assert!(may || !is, "{:?}", [x, y, right, bottom]);
            (prominent, quickly) = (prominent + usize::from(is), quickly + usize::from(!may));
        }
        assert!(prominent > 100 && quickly > 100, "{prominent} {quickly}");
    }
}
