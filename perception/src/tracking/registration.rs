//! Registration of an image patch: where, and how large, it is in another image.
//!
//! A patch is a grid of points with values and gradients. It is registered by shift, scale, gain and offset: Lucas-Kanade, iteratively
//! reweighted least squares in the inverse compositional form of Baker and Matthews (2004), from the best of several starts. Positions
//! are in px of the whole image.

use crate::image::GreyView;
use nalgebra::{SMatrix, SVector};

/// Sampling grid over a patch: columns and rows.
const COLUMNS: usize = 28;
const ROWS: usize = 20;
const POINTS: usize = COLUMNS * ROWS;

/// Largest number of iterations.
const MAX_ITERATIONS: usize = 16;

/// Smallest share of the points that lie in both images.
const MIN_INSIDE: f64 = 0.85;

/// A registration is ambiguous if another one has a correlation that is less by at most the first value, in a column that differs by
/// more than the second, in px.
const AMBIGUITY: f64 = 0.05;
const AMBIGUOUS_PX: f64 = 1.5;
/// Smallest correlation of a start.
const MIN_CORRELATION: f64 = 0.5;

/// Distance of starts, as a share of half the patch's width, and at least in px: boxes jump by one or two strips.
const START_SHARE: f64 = 0.08;
const START_PX: f64 = 1.5;

/// Smallest share of the variance that the patch must explain.
const MIN_EXPLAINED_VARIANCE: f64 = 0.8;

/// Residual, in robust standard deviations, at which a point's weight is a quarter.
const TOLERANCE: f64 = 3.0;
/// Smallest variance of the residuals, in squared grey levels.
const MIN_SPREAD: f64 = 4.0;
/// Misalignment that is tolerated at edges, in px: what it makes of them counts as no residual.
const SHIFT_PX: f64 = 0.5;
/// Smallest mean weight of the points.
const MIN_WEIGHT: f64 = 0.5;

/// Inflation of the least-squares error, as neighbouring points are correlated.
const CORRELATION_FACTOR: f64 = 3.0;

/// A grey image reduced by an integer factor; its memory is reused.
#[derive(Debug, Default)]
pub struct ReducedImage {
    pixels: Vec<f32>,
    width: usize,
    height: usize,
    factor: usize,
    /// Position of the crop in the image.
    origin: (f64, f64),
}

impl ReducedImage {
    /// Memory for crops of images of up to `width` × `height` px.
    pub fn with_capacity(width: usize, height: usize) -> Self {
        Self { pixels: Vec::with_capacity(width * height), ..Self::default() }
    }

    /// Takes in a crop of the image that begins at `origin`, in px.
    pub fn fill(&mut self, crop: GreyView<'_>, origin: (u32, u32), factor: usize) {
        self.factor = factor;
        self.origin = (f64::from(origin.0), f64::from(origin.1));
        (self.width, self.height) = (crop.width() / factor, crop.height() / factor);
        self.pixels.clear();
        self.pixels.resize(self.width * self.height, 0.0);
        let share = 1.0 / (factor * factor) as f32;
        for (y, out) in self.pixels.chunks_exact_mut(self.width.max(1)).enumerate() {
            for row in y * factor..(y + 1) * factor {
                for (v, part) in out.iter_mut().zip(crop.row(row).chunks_exact(factor)) {
                    *v += part.iter().map(|&p| f32::from(p)).sum::<f32>() * share;
                }
            }
        }
    }

    /// Interpolated value at a position of the image, in px; `None` outside.
    #[inline]
    fn at(&self, x: f64, y: f64) -> Option<f32> {
        let factor = self.factor as f64;
        let u = (x - self.origin.0 + 0.5) / factor - 0.5;
        let v = (y - self.origin.1 + 0.5) / factor - 0.5;
        // Compared before the conversion: a number that is too large for an index, or none, is outside.
        let is_inside = |position: f64, size: usize| position >= 0.0 && position < size as f64 - 1.0;
        if !(is_inside(u, self.width) && is_inside(v, self.height)) {
            return None;
        }
        let (i, j) = (u as usize, v as usize);
        let (fx, fy) = ((u - i as f64) as f32, (v - j as f64) as f32);
        let above = &self.pixels[j * self.width + i..][..2];
        let below = &self.pixels[(j + 1) * self.width + i..][..2];
        let top = above[0] + fx * (above[1] - above[0]);
        let bottom = below[0] + fx * (below[1] - below[0]);
        Some(top + fy * (bottom - top))
    }
}

/// A rectangle of an image, in px: centre and size.
#[derive(Clone, Copy, Debug)]
pub struct Rectangle {
    /// Centre.
    pub centre: [f64; 2],
    /// Width and height.
    pub size: [f64; 2],
}

/// A point of a patch: offset from the centre in px, value, and gradient along x and y.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    x: f64,
    y: f64,
    value: f32,
    slope: (f32, f32),
}

/// Centre and scale of a patch in an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Column and row of the centre, in px.
    pub x: f64,
    /// See `x`.
    pub y: f64,
    /// Size, as a multiple of that of the patch.
    pub scale: f64,
}

/// A pose that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registered {
    /// The pose.
    pub pose: Pose,
    /// Standard deviation of its scale.
    pub scale_sigma: f64,
    /// Standard deviation of its column, in px.
    pub column_sigma_px: f64,
    /// Correlation of the patch with what is there; at most 1.
    pub likeness: f64,
}

/// An image patch; its memory is reused.
#[derive(Debug)]
pub struct ImagePatch {
    points: Vec<Point>,
    /// Factor by which images are reduced before they are compared.
    factor: usize,
}

impl Default for ImagePatch {
    fn default() -> Self {
        Self { points: Vec::with_capacity(POINTS), factor: 1 }
    }
}

impl ImagePatch {
    /// Forgets the patch.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Takes in a rectangle of the image of which `crop` begins at `origin`.
    pub fn store(
        &mut self,
        rectangle: Rectangle,
        (crop, origin): (GreyView<'_>, (u32, u32)),
        reduced: &mut ReducedImage,
    ) {
        let Rectangle { centre: [x0, y0], size: [width, height] } = rectangle;
        let step = (width / (COLUMNS - 1) as f64, height / (ROWS - 1) as f64);
        self.factor = (step.0.max(step.1).round() as usize).max(1);
        reduced.fill(crop, origin, self.factor);
        self.points.clear();
        let delta = 0.5 * self.factor as f64;
        for i in 0..POINTS {
            let x = (i % COLUMNS) as f64 * step.0 - width / 2.0;
            let y = (i / COLUMNS) as f64 * step.1 - height / 2.0;
            let at = |dx: f64, dy: f64| reduced.at(x0 + x + dx, y0 + y + dy);
            let (Some(value), Some(l), Some(r), Some(a), Some(b)) =
                (at(0.0, 0.0), at(-delta, 0.0), at(delta, 0.0), at(0.0, -delta), at(0.0, delta))
            else {
                continue;
            };
            let span = 2.0 * delta as f32;
            self.points.push(Point { x, y, value, slope: ((r - l) / span, (b - a) / span) });
        }
    }

    /// Reduces an image for comparison with this patch.
    pub fn reduce(&self, (crop, origin): (GreyView<'_>, (u32, u32)), reduced: &mut ReducedImage) {
        reduced.fill(crop, origin, self.factor);
    }

    /// Registers the patch to a reduced image from the best of these starts and of others around them, `reach` steps to each side.
    /// `None` also where the result is ambiguous, as with a repeating pattern such as the posts of a rail.
    pub fn register<const N: usize>(
        &self,
        image: &ReducedImage,
        starts: [Pose; N],
        reach: [i32; 2],
    ) -> Option<Registered> {
        if self.points.len() < POINTS / 2 {
            return None;
        }
        let half_px = self.points.iter().fold(0.0_f64, |most, p| most.max(p.x.abs()));
        let step = (START_SHARE * half_px).max(START_PX);
        let mut found = starts.map(|start| (MIN_CORRELATION, start));
        for best in &mut found {
            let start = best.1;
            for (i, k) in (-reach[1]..=reach[1]).flat_map(|k| (-reach[0]..=reach[0]).map(move |i| (i, k))) {
                let pose =
                    Pose { x: start.x + f64::from(i) * step, y: start.y + f64::from(k) * step, ..start };
                if let Some(correlation) = correlation(&self.points, image, pose)
                    && correlation > best.0
                {
                    *best = (correlation, pose);
                }
            }
        }
        let (most, start) = found.iter().copied().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        if most <= MIN_CORRELATION {
            return None;
        }
        let registered = refine(&self.points, image, start)?;
        if registered.likeness <= MIN_CORRELATION {
            return None;
        }
        let least = registered.likeness - AMBIGUITY;
        let is_other = |pose: Pose| (pose.x - registered.pose.x).abs() > AMBIGUOUS_PX;
        let others = found.iter().filter(|(value, pose)| *value > least && is_other(*pose));
        let is_ambiguous = others
            .filter_map(|(_, start)| refine(&self.points, image, *start))
            .any(|other| is_other(other.pose) && other.likeness > least);
        (!is_ambiguous).then_some(registered)
    }
}

/// Correlation of a patch with an image at a pose, from one third of the points.
fn correlation(points: &[Point], image: &ReducedImage, pose: Pose) -> Option<f64> {
    let (mut n, mut a, mut b, mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points.iter().step_by(3) {
        if let Some(v) = image.at(pose.x + pose.scale * p.x, pose.y + pose.scale * p.y) {
            let (t, v) = (f64::from(p.value), f64::from(v));
            (n, a, b) = (n + 1.0, a + t, b + v);
            (aa, bb, ab) = (aa + t * t, bb + v * v, ab + t * v);
        }
    }
    if n < MIN_INSIDE * (points.len() / 3) as f64 {
        return None;
    }
    let (va, vb) = (aa - a * a / n, bb - b * b / n);
    (va > 1e-6 && vb > 1e-6).then(|| (ab - a * b / n) / (va * vb).sqrt())
}

/// Least squares from a start; `None` if they do not converge, or the patch explains too little of the image. Part of a patch may show
/// what is behind the thing, or a limb that swings: what differs more than the rest counts less (iteratively reweighted, with the weights
/// of Geman and McClure).
fn refine(points: &[Point], image: &ReducedImage, mut pose: Pose) -> Option<Registered> {
    // Gain, offset, and variance of the residuals, of the last iteration.
    let mut last: Option<[f64; 3]> = None;
    for _ in 0..MAX_ITERATIONS {
        let mut normal = SMatrix::<f64, 5, 5>::zeros();
        let mut right = SVector::<f64, 5>::zeros();
        let (mut sum, mut squares, mut inside, mut weights) = (0.0, 0.0, 0.0, 0.0);
        for p in points {
            let Some(v) = image.at(pose.x + pose.scale * p.x, pose.y + pose.scale * p.y) else {
                continue;
            };
            let v = f64::from(v);
            let (gx, gy) = (f64::from(p.slope.0), f64::from(p.slope.1));
            let weight = last.map_or(1.0, |[gain, offset, spread]| {
                let difference = v - gain * f64::from(p.value) - offset;
                let shifted = SHIFT_PX * SHIFT_PX * gain * gain * (gx * gx + gy * gy);
                (1.0 + difference * difference / (TOLERANCE * TOLERANCE * spread + shifted)).powi(-2)
            });
            let row = SVector::<f64, 5>::new(gx, gy, gx * p.x + gy * p.y, p.value.into(), 1.0);
            normal.syger(weight, &row, &row, 1.0);
            right += row * (weight * v);
            (sum, squares) = (sum + weight * v, squares + weight * v * v);
            (inside, weights) = (inside + 1.0, weights + weight);
        }
        if inside < MIN_INSIDE * points.len() as f64 || weights < MIN_WEIGHT * inside {
            return None;
        }
        // Only the lower triangle was filled.
        normal.fill_upper_triangle_with_lower_triangle();
        let inverse = normal.try_inverse()?;
        let solution = inverse * right;
        let gain = solution[3];
        if !(0.3..=3.0).contains(&gain) {
            return None;
        }
        let [dx, dy, ds] = [solution[0] / gain, solution[1] / gain, solution[2] / gain];
        if ds.abs() > 0.3 {
            return None;
        }
        pose.scale /= 1.0 + ds;
        pose.x -= pose.scale * dx;
        pose.y -= pose.scale * dy;
        if !(0.5..=2.5).contains(&pose.scale) {
            return None;
        }
        let errors = (squares - right.dot(&solution)).max(0.0);
        let is_weighted = last.is_some();
        last = Some([gain, solution[4], (errors / weights).max(MIN_SPREAD)]);
        if is_weighted && ds.abs() < 5e-4 && dx.hypot(dy) < 0.03 {
            let spread = squares - sum * sum / weights;
            if errors > (1.0 - MIN_EXPLAINED_VARIANCE) * spread {
                return None;
            }
            let variance = errors / (weights - 5.0) / (gain * gain);
            // Reweighting underestimates the error, for normal noise by a sixth: division by the mean weight compensates for that.
            let factor = CORRELATION_FACTOR * inside / weights;
            let sigma = |k: usize| factor * pose.scale * (variance * inverse[(k, k)]).max(0.0).sqrt();
            return Some(Registered {
                pose,
                scale_sigma: sigma(2),
                column_sigma_px: sigma(0),
                // All points together, whatever their weights.
                likeness: correlation(points, image, pose).unwrap_or(0.0),
            });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_that_is_no_index_is_outside_the_image() {
        let pixels = [7_u8; 20 * 10];
        let mut image = ReducedImage::default();
        for factor in [1, 2, 30] {
            image.fill(GreyView::new(&pixels, 20, 10, 20).unwrap(), (0, 0), factor);
            for far in [-1.0, 20.0, 1e19, 2.0_f64.powi(64), f64::MAX, f64::INFINITY, f64::NAN] {
                assert_eq!((image.at(far, 4.0), image.at(4.0, far)), (None, None), "{far}, factor {factor}");
            }
        }
        image.fill(GreyView::new(&pixels, 20, 10, 20).unwrap(), (0, 0), 1);
        assert_eq!((image.at(18.9, 8.9), image.at(19.0, 4.0), image.at(4.0, 9.0)), (Some(7.0), None, None));
    }

    /// A smooth image whose texture is shifted and scaled about its middle.
    fn image(shift: [f64; 2], scale: f64) -> Vec<u8> {
        let texture = |x: f64, y: f64| {
            let wave = |fx: f64, fy: f64| (fx * x + fy * y).sin();
            110.0 + 30.0 * (wave(0.21, 0.03) + wave(-0.05, 0.26) + wave(0.11, 0.15))
        };
        (0..120 * 100)
            .map(|i| {
                let (x, y) = ((i % 120) as f64 - 60.0 - shift[0], (i / 120) as f64 - 50.0 - shift[1]);
                texture(x / scale, y / scale) as u8
            })
            .collect()
    }

    #[test]
    fn shift_and_scale_are_found_to_a_fraction_of_a_pixel() {
        let (mut reduced, mut patch) = (ReducedImage::default(), ImagePatch::default());
        let first = image([0.0; 2], 1.0);
        patch.store(Rectangle { centre: [60.0, 50.0], size: [40.0, 40.0] }, view(&first), &mut reduced);
        let start = Pose { x: 60.0, y: 50.0, scale: 1.0 };
        for (shift, scale) in [([0.0, 0.0], 1.0), ([3.3, -1.6], 1.0), ([-2.7, 0.8], 1.08), ([0.4, 0.2], 0.93)]
        {
            let second = image(shift, scale);
            patch.reduce(view(&second), &mut reduced);
            let found = patch.register(&reduced, [start], [2, 1]).expect("it is there");
            let errors = [found.pose.x - 60.0 - shift[0], found.pose.y - 50.0 - shift[1]];
            assert!(errors.iter().all(|e| e.abs() < 0.06), "{shift:?} {scale}: {errors:?}");
            assert!((found.pose.scale - scale).abs() < 0.004 && found.likeness > 0.995, "{found:?}");
            assert!(found.scale_sigma < 0.02 && found.column_sigma_px < 0.3, "{found:?}");
        }
        let flat = vec![90; 120 * 100];
        patch.reduce(view(&flat), &mut reduced);
        assert_eq!(patch.register(&reduced, [start], [2, 1]), None, "nothing is there");
    }

    #[test]
    fn what_is_seen_beside_the_thing_does_not_count() {
        let (mut reduced, mut patch) = (ReducedImage::default(), ImagePatch::default());
        // The upper left quarter shows what is behind it, which stays.
        let picture = |shift: [f64; 2], scale: f64| -> Vec<u8> {
            let (thing, behind) = (image(shift, scale), image([31.0, 17.0], 0.7));
            (0..120 * 100)
                .map(|i| {
                    let (x, y) = ((i % 120) as f64 - 60.0 - shift[0], (i / 120) as f64 - 50.0 - shift[1]);
                    if x < 0.0 && y < 0.0 { behind[i] } else { thing[i] }
                })
                .collect()
        };
        let first = picture([0.0; 2], 1.0);
        patch.store(Rectangle { centre: [60.0, 50.0], size: [40.0, 40.0] }, view(&first), &mut reduced);
        let start = Pose { x: 60.0, y: 50.0, scale: 1.0 };
        for (shift, scale) in [([3.3, -1.6], 1.0), ([-1.7, 0.8], 1.0)] {
            let second = picture(shift, scale);
            patch.reduce(view(&second), &mut reduced);
            let found = patch.register(&reduced, [start], [2, 1]).expect("it is there");
            let errors = [found.pose.x - 60.0 - shift[0], found.pose.y - 50.0 - shift[1]];
            // Without weights the error is up to 0.9 px.
            assert!(errors.iter().all(|e| e.abs() < 0.4), "{shift:?} {scale}: {errors:?}");
            assert!((found.pose.scale - scale).abs() < 0.01 && found.likeness < 0.985, "{found:?}");
        }
    }

    #[test]
    fn what_repeats_itself_is_ambiguous() {
        let (mut reduced, mut patch) = (ReducedImage::default(), ImagePatch::default());
        // Posts every 12 px, with or without something between two of them.
        let posts = |mark: f64| -> Vec<u8> {
            (0..120 * 100)
                .map(|i| {
                    let (x, y) = (f64::from(i % 120) - 60.0, f64::from(i / 120) - 50.0);
                    let post = 40.0 * (std::f64::consts::TAU * x / 12.0).cos() + 8.0 * (0.2 * y).sin();
                    let far = (x / 5.0).powi(2) + (y / 6.0).powi(2);
                    (110.0 + post + mark * (-far).exp()) as u8
                })
                .collect()
        };
        let starts = [60.0, 72.0].map(|x| Pose { x, y: 50.0, scale: 1.0 });
        for (mark, is_found) in [(0.0, false), (90.0, true)] {
            let image = posts(mark);
            patch.store(Rectangle { centre: [60.0, 50.0], size: [20.0, 24.0] }, view(&image), &mut reduced);
            patch.reduce(view(&image), &mut reduced);
            let found = patch.register(&reduced, starts, [2, 1]);
            assert_eq!(found.is_some(), is_found, "{mark}: {found:?}");
            assert!(found.is_none_or(|found| (found.pose.x - 60.0).abs() < 0.06), "{found:?}");
            // From one start there is one place.
            assert!(patch.register(&reduced, [starts[0]], [2, 1]).is_some());
        }
    }

    fn view(pixels: &[u8]) -> (GreyView<'_>, (u32, u32)) {
        (GreyView::new(pixels, 120, 100, 120).expect("valid size"), (0, 0))
    }
}
