//! Monitors epipolar alignment: estimates the vertical offset between matching points of a rectified pair and
//! its gradients over the image, to detect that the cameras have moved since their calibration.
//!
//! The paper estimates this epipolar line distortion from its matches as a convex problem and feeds it
//! back online. Here, in every cell of a grid, the strongest corner among the pixels with a confident disparity
//! is searched in the right image in both directions and refined to sub-pixel precision. A plane (offset +
//! gradients) is fitted to the vertical offsets of the last frames with Huber's loss, which is convex and so
//! has a single solution for any start value.
//!
//! The offset corresponds to pitch (or one shifted principal point), the gradient along x to roll, the
//! gradient along y to different focal lengths. The baseline is not observable this way, and yaw hardly.

use super::disparity::DisparityView;
use crate::image::GreyView;
use nalgebra::{Matrix3, Vector3};

/// Parameters of the monitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarParameters {
    /// Maximum vertical offset that is searched, in pixels.
    pub reach_px: usize,
    /// Minimum confidence of a disparity, 0 to 255.
    pub confidence: u8,
    /// Half-life of a point's weight, in frames.
    pub half_life: f64,
    /// Maximum offset anywhere in the image, in pixels; above it the calibration is degraded.
    pub bound_px: f64,
    /// Threshold of Huber's loss, in pixels.
    pub huber_px: f64,
}

impl Default for EpipolarParameters {
    fn default() -> Self {
        Self { reach_px: 5, confidence: 64, half_life: 5.0, bound_px: 0.5, huber_px: 0.3 }
    }
}

/// Epipolar alignment of the pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EpipolarState {
    /// Too few points were found.
    #[default]
    Unknown,
    /// The offset is within the bound.
    Good,
    /// The offset exceeds the bound: matching degrades, and the cameras should be calibrated again.
    Degraded,
}

/// The estimate from the last frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EpipolarHealth {
    /// Epipolar alignment of the pair.
    pub state: EpipolarState,
    /// Row in the right image minus row in the left image, at the centre of the image, in pixels.
    pub offset_px: f64,
    /// Change of the offset from the centre to the right border, in pixels.
    pub across_px: f64,
    /// Change of the offset from the centre to the lower border, in pixels.
    pub down_px: f64,
    /// Standard deviation of the offset, in pixels.
    pub sigma_px: f64,
    /// Largest absolute offset in the image, in pixels.
    pub worst_px: f64,
    /// Number of points of the last frame.
    pub points: usize,
}

/// Grid cells along the columns and the rows of the image.
const CELLS: (usize, usize) = (20, 12);
/// Radius of a patch.
const HALF: usize = 4;
const SIDE: usize = 2 * HALF + 1;
/// Columns on both sides of the disparity in which a patch is searched.
const ASIDE: usize = 4;
/// Minimum corner response: smaller eigenvalue of a patch's structure tensor per pixel, in squared grey levels.
const MIN_CORNER: f32 = 12.0;
/// Minimum weight of points for a state other than unknown.
const MIN_POINTS: f64 = 60.0;
/// Factor on the weight of past frames when the current frame contradicts them.
const FORGET: f64 = 0.3;
/// Share of the bound below which a degraded state becomes good again (hysteresis).
const RECOVERY: f64 = 0.7;

/// Monitor of one camera pair, updated frame by frame. Updates do not allocate.
#[derive(Clone, Debug)]
pub struct EpipolarCheck {
    parameters: EpipolarParameters,
    points: Vec<[f64; 3]>,
    information: Matrix3<f64>,
    right: Vector3<f64>,
    weight: f64,
    squares: f64,
    estimate: Vector3<f64>,
    health: EpipolarHealth,
}

/// A patch around a pixel with its derivatives.
struct Patch {
    grey: [f32; SIDE * SIDE],
    dx: [f32; SIDE * SIDE],
    dy: [f32; SIDE * SIDE],
    /// Structure tensor: sums of dx², dx·dy, dy².
    structure: [f32; 3],
}

impl Patch {
    fn new(image: GreyView<'_>, x: usize, y: usize) -> Self {
        let mut patch = Self {
            grey: [0.0; SIDE * SIDE],
            dx: [0.0; SIDE * SIDE],
            dy: [0.0; SIDE * SIDE],
            structure: [0.0; 3],
        };
        for j in 0..SIDE {
            let v = y + j - HALF;
            let (above, row, below) = (image.row(v - 1), image.row(v), image.row(v + 1));
            for i in 0..SIDE {
                let u = x + i - HALF;
                let k = j * SIDE + i;
                patch.grey[k] = f32::from(row[u]);
                let (dx, dy) = (
                    0.5 * (f32::from(row[u + 1]) - f32::from(row[u - 1])),
                    0.5 * (f32::from(below[u]) - f32::from(above[u])),
                );
                (patch.dx[k], patch.dy[k]) = (dx, dy);
                patch.structure[0] += dx * dx;
                patch.structure[1] += dx * dy;
                patch.structure[2] += dy * dy;
            }
        }
        patch
    }

    /// Zero-mean sum of squared differences to a patch of another image, over every other row.
    fn difference(&self, image: GreyView<'_>, x: usize, y: usize) -> f32 {
        let mut sums = [0.0_f32; SIDE];
        let mut squares = [0.0_f32; SIDE];
        for j in (0..SIDE).step_by(2) {
            let row = &image.row(y + j - HALF)[x - HALF..x + HALF + 1];
            let own = &self.grey[j * SIDE..(j + 1) * SIDE];
            for i in 0..SIDE {
                let d = own[i] - f32::from(row[i]);
                sums[i] += d;
                squares[i] += d * d;
            }
        }
        let (sum, squares) = (sums.iter().sum::<f32>(), squares.iter().sum::<f32>());
        squares - sum * sum / (SIDE * SIDE.div_ceil(2)) as f32
    }
}

/// Corner response (Shi–Tomasi): the smaller eigenvalue of the patch's structure tensor per pixel, from every
/// other pixel of every other row.
fn corner(image: GreyView<'_>, x: usize, y: usize) -> f32 {
    const TAKEN: usize = HALF + 1;
    let (mut a, mut b, mut c) = (0_i32, 0_i32, 0_i32);
    for j in 0..TAKEN {
        let v = y + 2 * j - HALF;
        let span = x - HALF - 1..x + HALF + 2;
        let (above, row, below) =
            (&image.row(v - 1)[span.clone()], &image.row(v)[span.clone()], &image.row(v + 1)[span]);
        for i in 0..TAKEN {
            let at = 2 * i + 1;
            // Twice the derivatives.
            let dx = i32::from(row[at + 1]) - i32::from(row[at - 1]);
            let dy = i32::from(below[at]) - i32::from(above[at]);
            a += dx * dx;
            b += dx * dy;
            c += dy * dy;
        }
    }
    let [a, b, c] = [a, b, c].map(|sum| sum as f32 / 4.0);
    let root = ((a - c) * (a - c) + 4.0 * b * b).sqrt();
    0.5 * (a + c - root) / (TAKEN * TAKEN) as f32
}

impl EpipolarCheck {
    /// A monitor without any observation.
    pub fn new(parameters: EpipolarParameters) -> Self {
        Self {
            parameters,
            points: Vec::with_capacity(CELLS.0 * CELLS.1),
            information: Matrix3::zeros(),
            right: Vector3::zeros(),
            weight: 0.0,
            squares: 0.0,
            estimate: Vector3::zeros(),
            health: EpipolarHealth::default(),
        }
    }

    /// The current estimate.
    pub fn health(&self) -> EpipolarHealth {
        self.health
    }

    /// Discards all frames; to be called after a new calibration or a correction.
    pub fn reset(&mut self) {
        let points = std::mem::take(&mut self.points);
        *self = Self { points, ..Self::new(self.parameters) };
        self.points.clear();
    }

    /// Updates the estimate with a rectified pair, its disparities and confidences. Images that are smaller
    /// than a few patches or whose size differs from the map's are ignored.
    pub fn update(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        disparity: DisparityView<'_>,
        confidence: &[u8],
    ) -> EpipolarHealth {
        let (width, height) = (left.width(), left.height());
        let same = (right.width(), right.height()) == (width, height)
            && (disparity.width(), disparity.height()) == (width, height)
            && confidence.len() == width * height;
        let margin = HALF + self.parameters.reach_px.max(ASIDE) + 3;
        if !same || width < 4 * margin || height < 4 * margin {
            return self.health;
        }
        self.points.clear();
        for cell in 0..CELLS.0 * CELLS.1 {
            let (i, j) = (cell % CELLS.0, cell / CELLS.0);
            let span = |k: usize, n: usize, length: usize| {
                let inner = length - 2 * margin;
                (margin + k * inner / n, margin + (k + 1) * inner / n)
            };
            let (columns, rows) = (span(i, CELLS.0, width), span(j, CELLS.1, height));
            if let Some(point) = self.point_of_cell(left, right, disparity, confidence, columns, rows) {
                self.points.push(point);
            }
        }
        self.fit();
        self.health
    }

    /// The strongest corner of a cell: normalised x and y from −1 to 1, and its vertical offset in pixels.
    fn point_of_cell(
        &self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        disparity: DisparityView<'_>,
        confidence: &[u8],
        columns: (usize, usize),
        rows: (usize, usize),
    ) -> Option<[f64; 3]> {
        let (width, height) = (left.width(), left.height());
        let margin = HALF + self.parameters.reach_px.max(ASIDE) + 3;
        let mut best: Option<(f32, usize, usize)> = None;
        for y in (rows.0..rows.1).step_by(3) {
            let (disparities, grey, next) = (disparity.row(y), left.row(y), left.row(y + 1));
            for x in (columns.0..columns.1).step_by(3) {
                let d = usize::from(disparities[x]) / 256;
                if disparities[x] == 0
                    || confidence[y * width + x] < self.parameters.confidence
                    || x < d + margin
                    // Most pixels are flat: a cheap test before the whole patch.
                    || grey[x].abs_diff(grey[x + 1]).max(grey[x].abs_diff(next[x])) < 4
                {
                    continue;
                }
                let corner = corner(left, x, y);
                if corner > MIN_CORNER && best.is_none_or(|b| corner > b.0) {
                    best = Some((corner, x, y));
                }
            }
        }
        let (_, x, y) = best?;
        let patch = Patch::new(left, x, y);
        let offset = self.offset(&patch, right, x, y, f32::from(disparity.row(y)[x]) / 256.0)?;
        let place = |v: usize, length: usize| 2.0 * v as f64 / (length - 1) as f64 - 1.0;
        Some([place(x, width), place(y, height), offset])
    }

    /// Vertical offset of the patch around (x, y) in the right image, in pixels; positive is lower.
    fn offset(&self, patch: &Patch, right: GreyView<'_>, x: usize, y: usize, disparity: f32) -> Option<f64> {
        let reach = self.parameters.reach_px;
        let middle = (x as f32 - disparity).round() as usize;
        // The best integer position; disparities are wrong as well where rows do not match.
        let (mut least, mut at) = (f32::INFINITY, (0, 0));
        for v in y - reach..=y + reach {
            for u in middle - ASIDE..=middle + ASIDE {
                let difference = patch.difference(right, u, v);
                if difference < least {
                    (least, at) = (difference, (u, v));
                }
            }
        }
        if at.0.abs_diff(middle) == ASIDE || at.1.abs_diff(y) == reach {
            return None;
        }
        // Gauss–Newton refinement from there, invariant to brightness.
        let (mut u, mut v) = (at.0 as f32, at.1 as f32);
        let n = (SIDE * SIDE) as f32;
        let [a, b, c] = patch.structure;
        let (mx, my) = (patch.dx.iter().sum::<f32>() / n, patch.dy.iter().sum::<f32>() / n);
        let (a, b, c) = (a - n * mx * mx, b - n * mx * my, c - n * my * my);
        let determinant = a * c - b * b;
        if determinant < 1.0 {
            return None;
        }
        let mut residual = 0.0;
        for _ in 0..6 {
            let (u0, v0) = (u.floor(), v.floor());
            let (fu, fv) = (u - u0, v - v0);
            let (left_edge, top_edge) = (u0 as usize - HALF, v0 as usize - HALF);
            let (mut gx, mut gy, mut sum, mut squares) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
            for j in 0..SIDE {
                let (upper, lower) = (right.row(top_edge + j), right.row(top_edge + j + 1));
                for i in 0..SIDE {
                    let mix = |row: &[u8]| {
                        let (p, q) = (f32::from(row[left_edge + i]), f32::from(row[left_edge + i + 1]));
                        p + fu * (q - p)
                    };
                    let (p, q) = (mix(upper), mix(lower));
                    let k = j * SIDE + i;
                    let d = patch.grey[k] - (p + fv * (q - p));
                    gx += (patch.dx[k] - mx) * d;
                    gy += (patch.dy[k] - my) * d;
                    sum += d;
                    squares += d * d;
                }
            }
            residual = (squares - sum * sum / n) / n;
            let (du, dv) = ((c * gx - b * gy) / determinant, (a * gy - b * gx) / determinant);
            u += du;
            v += dv;
            let lost = (u - at.0 as f32).abs() > 1.5 || (v - at.1 as f32).abs() > 1.5;
            if lost || !u.is_finite() || !v.is_finite() {
                return None;
            }
            if du.abs().max(dv.abs()) < 0.01 {
                break;
            }
        }
        // The residual must be small compared to the contrast of the patch.
        (residual < 0.08 * (a + c) / n + 3.0).then(|| f64::from(v - y as f32))
    }

    /// Fits the plane to the points of this frame and the weighted points of past frames.
    fn fit(&mut self) {
        let mut keep = 0.5_f64.powf(1.0 / self.parameters.half_life);
        // If most points contradict the past, the cameras may have moved: past frames lose weight faster.
        let expected = |p: &[f64; 3]| Vector3::new(1.0, p[0], p[1]).dot(&self.estimate);
        let far = self.points.iter().filter(|p| (p[2] - expected(p)).abs() > 2.0 * self.parameters.huber_px);
        if self.points.len() >= 15 && 2 * far.count() > self.points.len() {
            keep *= FORGET;
        }
        let (old, old_right) = (self.information * keep, self.right * keep);
        let mut estimate = self.estimate;
        if self.weight * keep < 10.0 {
            // No previous estimate: start from the median.
            let mut offsets = [0.0; CELLS.0 * CELLS.1];
            let count = self.points.len();
            for (o, p) in offsets.iter_mut().zip(&self.points) {
                *o = p[2];
            }
            offsets[..count].sort_unstable_by(f64::total_cmp);
            estimate = Vector3::new(if count > 0 { offsets[count / 2] } else { 0.0 }, 0.0, 0.0);
        }
        // A weak prior on the gradients, because all points may lie in one corner of the image.
        let pull = Matrix3::from_diagonal(&Vector3::new(0.0, 2.0, 2.0));
        let (mut information, mut right) = (old, old_right);
        let (mut weight, mut squares) = (0.0, 0.0);
        for _ in 0..8 {
            (information, right, weight, squares) = (old, old_right, 0.0, 0.0);
            for [x, y, offset] in &self.points {
                let row = Vector3::new(1.0, *x, *y);
                let r = offset - row.dot(&estimate);
                let w =
                    if r.abs() > self.parameters.huber_px { self.parameters.huber_px / r.abs() } else { 1.0 };
                information += row * row.transpose() * w;
                right += row * (w * offset);
                weight += w;
                squares += w * r * r;
            }
            let Some(inverse) = (information + pull).try_inverse() else { return };
            let next = inverse * right;
            let step = (next - estimate).norm();
            estimate = next;
            if step < 1e-4 {
                break;
            }
        }
        (self.information, self.right, self.estimate) = (information, right, estimate);
        self.weight = self.weight * keep + weight;
        self.squares = self.squares * keep + squares;
        let inverse = (information + pull).try_inverse().unwrap_or_default();
        let variance = self.squares / self.weight.max(1.0);
        let worst = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
            .map(|(x, y)| (estimate[0] + x * estimate[1] + y * estimate[2]).abs());
        let worst_px = worst.into_iter().fold(0.0, f64::max);
        let bound = self.parameters.bound_px;
        let state = if self.weight < MIN_POINTS {
            EpipolarState::Unknown
        } else if worst_px > bound {
            EpipolarState::Degraded
        } else if self.health.state == EpipolarState::Degraded && worst_px > RECOVERY * bound {
            // Hysteresis: a degraded state recovers only clearly below the bound.
            EpipolarState::Degraded
        } else {
            EpipolarState::Good
        };
        self.health = EpipolarHealth {
            state,
            offset_px: estimate[0],
            across_px: estimate[1],
            down_px: estimate[2],
            sigma_px: (variance * inverse[(0, 0)]).max(0.0).sqrt(),
            worst_px,
            points: self.points.len(),
        };
    }
}

impl EpipolarHealth {
    /// Source position of pixel (x, y) of the right image, in an image of `width` × `height` pixels, that
    /// restores epipolar alignment: for the table of a [`crate::rectify::Remap`].
    pub fn corrected(&self, (width, height): (usize, usize), x: usize, y: usize) -> (f64, f64) {
        let place = |v: usize, length: usize| 2.0 * v as f64 / (length.max(2) - 1) as f64 - 1.0;
        let offset = self.offset_px + self.across_px * place(x, width) + self.down_px * place(y, height);
        (x as f64, y as f64 + offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;
    use crate::rectify::Remap;
    use crate::simd::Level;

    const SIZE: (usize, usize) = (320, 240);

    /// A textured pair with disparities from 6 to 20 px; `field` is the vertical offset of the right image at a
    /// position.
    fn pair(field: impl Fn(f64, f64) -> f64, seed: u64) -> (GreyImage, GreyImage, Vec<u16>) {
        let (width, height) = SIZE;
        let mut random = fastrand::Rng::with_seed(seed);
        let coarse: Vec<f64> = (0..200 * 100).map(|_| random.f64() * 255.0).collect();
        let texture = |x: f64, y: f64| {
            let (x, y) = (x / 3.1 + 10.0, y / 3.1 + 5.0);
            let (i, j) = (x as usize, y as usize);
            let (fx, fy) = (x.fract(), y.fract());
            let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
            let at = |di: usize, dj: usize| coarse[(j + dj) * 200 + i + di];
            let (a, b) = (at(0, 0) + sx * (at(1, 0) - at(0, 0)), at(0, 1) + sx * (at(1, 1) - at(0, 1)));
            a + sy * (b - a)
        };
        let truth = |y: f64| 6.0 + 14.0 * y / height as f64;
        let (mut left, mut right) = (GreyImage::new(width, height), GreyImage::new(width, height));
        let mut disparity = vec![0; width * height];
        for y in 0..height {
            for x in 0..width {
                let (px, py) = (x as f64, y as f64);
                left.as_mut_slice()[y * width + x] = texture(px + 30.0, py + 10.0).round() as u8;
                disparity[y * width + x] = (truth(py) * 256.0) as u16;
                // Row y of the right image shows the content of row y − field.
                let row = py - field(px, py);
                right.as_mut_slice()[y * width + x] =
                    texture(px + 30.0 + truth(row), row + 10.0).round() as u8;
            }
        }
        (left, right, disparity)
    }

    fn run(check: &mut EpipolarCheck, pair: &(GreyImage, GreyImage, Vec<u16>)) -> EpipolarHealth {
        let map = DisparityView::new(&pair.2, SIZE.0, SIZE.1).unwrap();
        check.update(pair.0.view(), pair.1.view(), map, &vec![200; SIZE.0 * SIZE.1])
    }

    #[test]
    fn offsets_and_gradients_are_recovered() {
        for (offset, across, down) in [
            (0.0, 0.0, 0.0),
            (0.3, 0.0, 0.0),
            (-1.4, 0.0, 0.0),
            (0.2, 0.6, 0.0),
            (0.0, 0.0, -0.4),
            (2.6, -0.3, 0.2),
        ] {
            let pair =
                pair(|x, y| offset + across * (2.0 * x / 319.0 - 1.0) + down * (2.0 * y / 239.0 - 1.0), 3);
            let mut check = EpipolarCheck::new(EpipolarParameters::default());
            let health = (0..3).map(|_| run(&mut check, &pair)).last().unwrap();
            assert!(health.points > 100, "{health:?}");
            for (found, truth) in
                [(health.offset_px, offset), (health.across_px, across), (health.down_px, down)]
            {
                assert!((found - truth).abs() < 0.06, "{offset} {across} {down}: {health:?}");
            }
            let worst = f64::abs(offset) + f64::abs(across) + f64::abs(down);
            assert_eq!(health.state == EpipolarState::Degraded, worst > 0.5, "{health:?}");
            assert!(health.sigma_px < 0.05);
        }
    }

    #[test]
    fn wrong_disparities_do_not_move_the_estimate() {
        let mut pair = pair(|_, _| 0.4, 5);
        let mut random = fastrand::Rng::with_seed(5);
        for block in pair.2.chunks_mut(16) {
            if random.f64() < 0.3 {
                block.fill(random.u16(256..40 * 256));
            }
        }
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        let health = (0..5).map(|_| run(&mut check, &pair)).last().unwrap();
        assert!((health.offset_px - 0.4).abs() < 0.06, "{health:?}");
    }

    #[test]
    fn a_camera_rotation_is_detected_and_corrected() {
        let (good, turned) = (pair(|_, _| 0.0, 7), pair(|_, _| 1.5, 7));
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        for _ in 0..20 {
            run(&mut check, &good);
        }
        assert_eq!(check.health().state, EpipolarState::Good);
        let frames = (1..100).find(|_| run(&mut check, &turned).state == EpipolarState::Degraded).unwrap();
        assert!(frames <= 30, "{frames} frames");
        for _ in 0..40 {
            run(&mut check, &turned);
        }
        // After correction the state becomes good again, with and without a reset.
        let health = check.health();
        let table = Remap::new(Level::best(), SIZE.0, SIZE.1, |x, y| Some(health.corrected(SIZE, x, y)));
        let corrected = (turned.0.clone(), table.applied(turned.1.view()).unwrap(), turned.2.clone());
        let back = (1..100).find(|_| run(&mut check, &corrected).state == EpipolarState::Good).unwrap();
        assert!(back <= 30, "{back} frames");
        check.reset();
        assert_eq!(check.health().state, EpipolarState::Unknown);
        run(&mut check, &corrected);
        let health = run(&mut check, &corrected);
        assert!(health.state == EpipolarState::Good && health.offset_px.abs() < 0.1, "{health:?}");
    }

    #[test]
    fn without_texture_the_state_is_unknown() {
        let flat = (GreyImage::new(320, 240), GreyImage::new(320, 240), vec![2560; 320 * 240]);
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        assert_eq!(run(&mut check, &flat).state, EpipolarState::Unknown);
        let unknown = pair(|_, _| 1.0, 9);
        let unknown = (unknown.0, unknown.1, vec![0; 320 * 240]);
        assert_eq!(run(&mut check, &unknown).state, EpipolarState::Unknown);
        // Images of other sizes are ignored.
        let small = GreyImage::new(20, 20);
        let map = vec![300; 400];
        let view = DisparityView::new(&map, 20, 20).unwrap();
        check.update(small.view(), small.view(), view, &[200; 400]);
        check.update(flat.0.view(), small.view(), view, &[200; 400]);
    }
}
