//! The matching cost: structural similarity by running sums, blended with a truncated gradient
//! difference (paper, section 3.2).
//!
//! The paper's SSIM has three factors (luminance, contrast, structure). We use the separable form
//! of contrast × structure,
//!
//! ```text
//! s(p, d) = (cov + C) / √((varL + C)·(varR + C)),   C = (K₂·255)²/2,   |s| ≤ 1
//! ```
//!
//! because its denominator is a product of one factor per image: no division inside the loop over
//! disparities. Luminance is left out on purpose: two cameras differ in gain.
//! The cost is `(1 − share)·50·(1 − s) + share·100·min(|∂L − ∂R|, limit)/limit`, 0 to 100.

use super::volume::{LANES, Lanes};
use crate::image::GreyView;

/// The greatest cost of a node.
pub const MAX_COST: u8 = 100;

/// What shapes the matching cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostParameters {
    /// Half the window: 2 means 5 × 5 pixels.
    pub radius: usize,
    /// K₂ of SSIM: how much contrast a window needs to count, as a share of 255.
    pub k2: f32,
    /// Share of the gradient term, 0 to 1.
    pub gradient_share: f32,
    /// Gradient differences above this (Sobel/4: grey levels over two pixels) all cost the same.
    pub gradient_limit: u8,
}

impl Default for CostParameters {
    fn default() -> Self {
        Self { radius: 2, k2: 0.06, gradient_share: 0.2, gradient_limit: 16 }
    }
}

/// One image with its border repeated, and the window statistics of every pixel.
#[derive(Debug)]
struct Plane {
    /// Columns before pixel 0, the window radius not counted.
    lead: usize,
    /// Columns of the statistics: `lead` + the padded width.
    columns: usize,
    /// Grey values, `columns` + 2·radius a row, `height` + 2·radius rows.
    grey: Vec<u8>,
    /// Sum over the window.
    sum: Vec<f32>,
    /// 1/√(N²·var + N²·C).
    norm: Vec<f32>,
    /// Horizontal Sobel response / 4 + 128, clipped.
    gradient: Vec<u8>,
}

impl Plane {
    fn new(lead: usize, width: usize, height: usize, radius: usize) -> Self {
        let columns = lead + width.div_ceil(LANES) * LANES;
        let n = columns * height;
        Self {
            lead,
            columns,
            grey: vec![0; (columns + 2 * radius) * (height + 2 * radius)],
            sum: vec![0.0; n],
            norm: vec![0.0; n],
            gradient: vec![0; n],
        }
    }

    fn bytes(&self) -> usize {
        self.grey.len() + self.gradient.len() + 4 * (self.sum.len() + self.norm.len())
    }

    fn grey_row(&self, y: usize, radius: usize) -> &[u8] {
        let stride = self.columns + 2 * radius;
        &self.grey[y * stride..(y + 1) * stride]
    }

    fn fill(&mut self, image: GreyView<'_>, radius: usize, constant: f32, sums: &mut [[u32; 2]]) {
        let stride = self.columns + 2 * radius;
        let height = image.height();
        for (y, row) in self.grey.chunks_exact_mut(stride).enumerate() {
            let source = image.row(y.saturating_sub(radius).min(height - 1));
            let before = self.lead + radius;
            row[..before].fill(source[0]);
            row[before..before + source.len()].copy_from_slice(source);
            row[before + source.len()..].fill(source[source.len() - 1]);
        }

        // Running column sums of values and squares; then windows along the row.
        let size = 2 * radius + 1;
        let n = (size * size) as f32;
        let sums = &mut sums[..stride];
        sums.fill([0, 0]);
        for y in 0..size - 1 {
            for (sum, &v) in sums.iter_mut().zip(&self.grey[y * stride..(y + 1) * stride]) {
                let v = u32::from(v);
                *sum = [sum[0] + v, sum[1] + v * v];
            }
        }
        for y in 0..height {
            let added = &self.grey[(y + size - 1) * stride..(y + size) * stride];
            for (sum, &v) in sums.iter_mut().zip(added) {
                let v = u32::from(v);
                *sum = [sum[0] + v, sum[1] + v * v];
            }
            let at = y * self.columns;
            for x in 0..self.columns {
                let [mut total, mut squares] = [0_u32; 2];
                for sum in &sums[x..x + size] {
                    total += sum[0];
                    squares += sum[1];
                }
                // N²·variance, exact in integers.
                let variance = (size * size) as u64 * u64::from(squares) - u64::from(total).pow(2);
                self.sum[at + x] = total as f32;
                // In double precision, where the integer is exact: the same on every machine.
                self.norm[at + x] = (1.0 / (variance as f64 + f64::from(n * n * constant)).sqrt()) as f32;
            }
            let removed = &self.grey[y * stride..(y + 1) * stride];
            for (sum, &v) in sums.iter_mut().zip(removed) {
                let v = u32::from(v);
                *sum = [sum[0] - v, sum[1] - v * v];
            }
            self.gradient_row(y, radius);
        }
    }

    fn gradient_row(&mut self, y: usize, radius: usize) {
        let stride = self.columns + 2 * radius;
        let row = |dy: usize| {
            let start = (y + radius + dy - 1) * stride + radius;
            &self.grey[start - 1..start + self.columns + 1]
        };
        let (above, here, below) = (row(0), row(1), row(2));
        let out = &mut self.gradient[y * self.columns..(y + 1) * self.columns];
        for (x, target) in out.iter_mut().enumerate() {
            let d = |r: &[u8]| i32::from(r[x + 2]) - i32::from(r[x]);
            *target = ((d(above) + 2 * d(here) + d(below)) / 4 + 128).clamp(0, 255) as u8;
        }
    }
}

/// Computes the cost of all nodes of an image, row by row, with memory allocated once.
#[derive(Debug)]
pub struct SsimCost {
    parameters: CostParameters,
    width: usize,
    height: usize,
    disparities: usize,
    left: Plane,
    right: Plane,
    /// Column sums of the products L·R(−d) for the current row: `[disparity][column]`.
    products: Vec<u32>,
    scratch: Vec<[u32; 2]>,
    gradient_cost: [u8; 256],
    next_row: usize,
}

impl SsimCost {
    /// A workspace for images of `width` × `height` pixels and disparities 0 to `disparities` − 1.
    ///
    /// # Panics
    /// When the radius is not 1 to 7.
    pub fn new(parameters: CostParameters, width: usize, height: usize, disparities: usize) -> Self {
        let radius = parameters.radius;
        assert!((1..=7).contains(&radius), "the SSIM window has a radius of 1 to 7");
        let left = Plane::new(0, width, height, radius);
        let right = Plane::new(disparities, width, height, radius);
        let mut gradient_cost = [0; 256];
        for (step, cost) in gradient_cost.iter_mut().enumerate() {
            let limit = f32::from(parameters.gradient_limit.max(1));
            let share = (step as f32 / limit).min(1.0) * parameters.gradient_share;
            *cost = (share * f32::from(MAX_COST)).round() as u8;
        }
        Self {
            products: vec![0; disparities * (left.columns + 2 * radius)],
            scratch: vec![[0, 0]; right.columns + 2 * radius],
            parameters,
            width,
            height,
            disparities,
            left,
            right,
            gradient_cost,
            next_row: 0,
        }
    }

    /// Bytes that the workspace holds.
    pub fn bytes(&self) -> usize {
        self.left.bytes() + self.right.bytes() + 4 * self.products.len() + 8 * self.scratch.len()
    }

    /// Takes in a new pair, of the size that the workspace was made for. Rows are then asked for
    /// from 0 on.
    ///
    /// # Panics
    /// When the sizes differ; callers check pairs before they come here.
    pub fn start(&mut self, left: GreyView<'_>, right: GreyView<'_>) {
        for image in [&left, &right] {
            assert_eq!((image.width(), image.height()), (self.width, self.height));
        }
        let radius = self.parameters.radius;
        let constant = (self.parameters.k2 * 255.0).powi(2) / 2.0;
        self.left.fill(left, radius, constant, &mut self.scratch);
        self.right.fill(right, radius, constant, &mut self.scratch);
        self.next_row = 0;
    }

    fn add_products(&mut self, row: usize, subtract: bool) {
        let radius = self.parameters.radius;
        let left = self.left.grey_row(row, radius);
        let right = self.right.grey_row(row, radius);
        let columns = left.len();
        for (d, sums) in self.products.chunks_exact_mut(columns).enumerate() {
            let shifted = &right[self.disparities - d..][..columns];
            if subtract {
                for ((sum, &l), &r) in sums.iter_mut().zip(left).zip(shifted) {
                    *sum -= u32::from(u16::from(l) * u16::from(r));
                }
            } else {
                for ((sum, &l), &r) in sums.iter_mut().zip(left).zip(shifted) {
                    *sum += u32::from(u16::from(l) * u16::from(r));
                }
            }
        }
    }

    /// Writes the costs of the next row to `out`: tile after tile, `disparities` lanes each.
    /// Pixels left of the right image (x < d) are compared with its border, repeated.
    ///
    /// # Panics
    /// When called more often than the image has rows, or `out` is not one row long.
    pub fn next_row(&mut self, out: &mut [Lanes]) {
        let y = self.next_row;
        assert!(y < self.height, "all rows of the pair were already given");
        assert_eq!(out.len(), self.left.columns / LANES * self.disparities);
        self.next_row += 1;
        let radius = self.parameters.radius;
        if y == 0 {
            self.products.fill(0);
            for row in 0..=2 * radius {
                self.add_products(row, false);
            }
        } else {
            self.add_products(y - 1, true);
            self.add_products(y + 2 * radius, false);
        }
        match radius {
            2 => self.score_row::<5>(y, out),
            3 => self.score_row::<7>(y, out),
            1 => self.score_row::<3>(y, out),
            4 => self.score_row::<9>(y, out),
            5 => self.score_row::<11>(y, out),
            6 => self.score_row::<13>(y, out),
            _ => self.score_row::<15>(y, out),
        }
    }

    fn score_row<const SIZE: usize>(&self, y: usize, out: &mut [Lanes]) {
        let stride = self.left.columns + SIZE - 1;
        let n = (SIZE * SIZE) as f32;
        let constant = n * n * (self.parameters.k2 * 255.0).powi(2) / 2.0;
        let half = 50.0 * (1.0 - self.parameters.gradient_share);
        let left_at = y * self.left.columns;
        let right_at = y * self.right.columns + self.right.lead;
        for (tile, nodes) in out.chunks_exact_mut(self.disparities).enumerate() {
            let x = tile * LANES;
            let left_sum: &[f32; LANES] = window(&self.left.sum, left_at + x);
            let left_norm: &[f32; LANES] = window(&self.left.norm, left_at + x);
            let left_gradient: &[u8; LANES] = window(&self.left.gradient, left_at + x);
            for (d, node) in nodes.iter_mut().enumerate() {
                let right_sum: &[f32; LANES] = window(&self.right.sum, right_at + x - d);
                let right_norm: &[f32; LANES] = window(&self.right.norm, right_at + x - d);
                let right_gradient: &[u8; LANES] = window(&self.right.gradient, right_at + x - d);
                let columns = &self.products[d * stride + x..][..LANES + SIZE - 1];
                for i in 0..LANES {
                    let mut product = 0_u32;
                    for k in 0..SIZE {
                        product += columns[i + k];
                    }
                    let covariance = n * (product as i32 as f32) - left_sum[i] * right_sum[i];
                    let s = (covariance + constant) * (left_norm[i] * right_norm[i]);
                    let cost = (half - half * s).clamp(0.0, 100.0) + 0.5;
                    node.0[i] = cost as i32 as u8;
                }
                for i in 0..LANES {
                    let step = left_gradient[i].abs_diff(right_gradient[i]);
                    node.0[i] += self.gradient_cost[usize::from(step)];
                }
            }
        }
    }
}

/// [`LANES`] values from `start` on, as an array.
#[inline(always)]
fn window<T>(values: &[T], start: usize) -> &[T; LANES] {
    values[start..start + LANES].try_into().expect("the slice has exactly LANES values")
}

/// The definition of the cost of one node, from the images themselves: the oracle of the tests.
/// Pixels outside are those of the border; x − d may lie outside too.
pub fn cost_brute_force(
    parameters: CostParameters,
    left: GreyView<'_>,
    right: GreyView<'_>,
    x: usize,
    y: usize,
    d: usize,
) -> f64 {
    let at = |image: GreyView<'_>, x: i64, y: i64| {
        let x = x.clamp(0, image.width() as i64 - 1) as usize;
        f64::from(image.at(x, y.clamp(0, image.height() as i64 - 1) as usize))
    };
    let (x, y, d, r) = (x as i64, y as i64, d as i64, parameters.radius as i64);
    let (mut n, mut sl, mut sr, mut sll, mut srr, mut slr) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for dy in -r..=r {
        for dx in -r..=r {
            let (l, v) = (at(left, x + dx, y + dy), at(right, x + dx - d, y + dy));
            n += 1.0;
            sl += l;
            sr += v;
            sll += l * l;
            srr += v * v;
            slr += l * v;
        }
    }
    let constant = (f64::from(parameters.k2) * 255.0).powi(2) / 2.0;
    let (var_l, var_r) = (sll / n - (sl / n).powi(2), srr / n - (sr / n).powi(2));
    let covariance = slr / n - sl / n * (sr / n);
    let s = (covariance + constant) / ((var_l + constant) * (var_r + constant)).sqrt();
    let gradient = |image: GreyView<'_>, x: i64| {
        let d = |dy: i64| at(image, x + 1, y + dy) - at(image, x - 1, y + dy);
        (((d(-1) + 2.0 * d(0) + d(1)) / 4.0).trunc() + 128.0).clamp(0.0, 255.0)
    };
    let step = (gradient(left, x) - gradient(right, x - d)).abs();
    let share = f64::from(parameters.gradient_share);
    let limit = f64::from(parameters.gradient_limit);
    (1.0 - share) * 50.0 * (1.0 - s) + share * 100.0 * step.min(limit) / limit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    #[test]
    fn running_sums_equal_the_definition() {
        for (width, height, disparities, radius, seed) in
            [(1, 1, 1, 2, 0), (40, 7, 16, 2, 1), (33, 9, 40, 3, 2), (64, 5, 8, 1, 3), (20, 20, 5, 5, 4)]
        {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut left = GreyImage::new(width, height);
            let mut right = GreyImage::new(width, height);
            for image in [&mut left, &mut right] {
                // Smooth ramps with noise, so that similar and dissimilar windows both occur.
                for (i, v) in image.as_mut_slice().iter_mut().enumerate() {
                    *v = ((i % width * 3) as u8).wrapping_add(random.u8(..60));
                }
            }
            let parameters = CostParameters { radius, ..CostParameters::default() };
            let mut cost = SsimCost::new(parameters, width, height, disparities);
            let mut row = vec![Lanes::ZERO; width.div_ceil(LANES) * disparities];
            for _ in 0..2 {
                cost.start(left.view(), right.view());
                for y in 0..height {
                    cost.next_row(&mut row);
                    for x in 0..width {
                        for d in 0..disparities {
                            let exact = cost_brute_force(parameters, left.view(), right.view(), x, y, d);
                            let got = row[x / LANES * disparities + d].0[x % LANES];
                            assert!(
                                (f64::from(got) - exact).abs() <= 1.01 && got <= MAX_COST,
                                "({x}, {y}) d {d}: {got} for {exact}, seed {seed}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_true_disparity_costs_nothing() {
        let mut random = fastrand::Rng::with_seed(9);
        let (width, height, shift) = (64, 16, 5);
        let mut left = GreyImage::new(width, height);
        left.as_mut_slice().iter_mut().for_each(|v| *v = random.u8(..));
        let mut right = GreyImage::new(width, height);
        for y in 0..height {
            for x in 0..width {
                right.as_mut_slice()[y * width + x] = left.view().at((x + shift).min(width - 1), y);
            }
        }
        let mut cost = SsimCost::new(CostParameters::default(), width, height, 8);
        cost.start(left.view(), right.view());
        let mut row = vec![Lanes::ZERO; 2 * 8];
        cost.next_row(&mut row);
        let inside = shift + 4..width - shift - 4;
        let wrong: Vec<u8> = inside.clone().map(|x| row[x / LANES * 8 + 1].0[x % LANES]).collect();
        for x in inside {
            assert_eq!(row[x / LANES * 8 + shift].0[x % LANES], 0, "x {x}");
        }
        assert!(wrong.iter().all(|&cost| cost > 0), "{wrong:?}");
    }
}
