//! Scale change of an obstacle's image, that is closing speed / distance, measured from pixels.
//!
//! At long range disparity gives little information on speed: at 35 m, with a baseline of 12 cm, an error of
//! a tenth of a pixel is a metre. Meanwhile the image grows by a sixth in two fifths of a second, and a
//! template match determines the scale to a fraction of a percent. The image patch of a track is therefore
//! stored as a template and registered to the current image by shift, scale, gain and offset (Lucas-Kanade
//! least squares in the inverse compositional form of Baker and Matthews). At short range, where the depth of
//! an obstacle distorts its image, disparity is more accurate again; the estimated error accounts for that.

use super::filter::DistanceFilter;
use super::{Track, Tracker};
use crate::image::GreyView;
use crate::region::PixelBox;
use nalgebra::{SMatrix, SVector};

/// Sampling grid over the box: columns and rows.
const COLUMNS: usize = 28;
const ROWS: usize = 20;
const POINTS: usize = COLUMNS * ROWS;

/// Largest number of tracks that are measured at the same time; the nearest are selected.
const MAX_TRACKS: usize = 8;

/// Share of the box's width and height that is sampled; its margin shows background.
const INNER_SHARE: f64 = 0.75;

/// Smallest box that is measured, in px.
const MIN_PX: (u32, u32) = (14, 10);

/// Nearer than the first distance disparity is more accurate; farther to the side than the second no
/// collision is possible. In metres.
const MIN_DISTANCE_M: f64 = 5.0;
const MAX_LATERAL_M: f64 = 6.0;

/// Smallest time between two compared views, in ns, unless the predicted scale change reaches the second
/// value.
const INTERVAL_NS: u64 = 380_000_000;
const MAX_SCALE_CHANGE: f64 = 1.2;
/// Largest time between two compared views, in ns; later, illumination and aspect have changed.
const MAX_AGE_NS: u64 = 900_000_000;

/// Largest number of iterations.
const MAX_ITERATIONS: usize = 16;

/// Smallest share of the points that lie in both images.
const MIN_INSIDE: f64 = 0.85;

/// Smallest share of the variance that the template must explain.
const MIN_EXPLAINED_VARIANCE: f64 = 0.8;

/// Inflation of the least-squares error, as neighbouring points are correlated, and smallest standard
/// deviation of the scale.
const CORRELATION_FACTOR: f64 = 3.0;
const MIN_SIGMA: f64 = 0.004;

/// Uncertainty of the depth of the visible surface behind the tracked near side, in metres.
const DEPTH_OFFSET_M: f64 = 0.4;

/// Scale rates with a larger normalised innovation are rejected.
const GATE_SIGMAS: f64 = 4.0;

/// Rate of scale change of an image, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleRate {
    /// Closing speed / distance, in 1/s: the inverse of the time to collision.
    pub per_s: f64,
    /// Standard deviation, in 1/s.
    pub sigma_per_s: f64,
    /// Time over which it is the mean, in seconds.
    pub interval_s: f64,
}

/// A grey image reduced by an integer factor; its memory is reused.
#[derive(Debug, Default)]
struct ReducedImage {
    pixels: Vec<f32>,
    width: usize,
    height: usize,
    factor: usize,
    /// Position of the crop in the image.
    origin: (f64, f64),
}

impl ReducedImage {
    fn fill(&mut self, crop: GreyView<'_>, origin: (u32, u32), factor: usize) {
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

/// A point of a template: offset from the centre in px, value, and gradient along x and y.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    x: f64,
    y: f64,
    value: f32,
    slope: (f32, f32),
}

/// A stored image patch of a track.
#[derive(Debug)]
struct Template {
    track: u32,
    time_ns: u64,
    /// Time of the last request.
    last_used_ns: u64,
    distance_m: f64,
    factor: usize,
    points: Vec<Point>,
}

/// Centre and scale of a template in an image.
#[derive(Clone, Copy, Debug)]
struct Pose {
    x: f64,
    y: f64,
    scale: f64,
}

/// Measures scale change; memory is allocated once.
#[derive(Debug)]
pub struct ScaleChangeMeter {
    templates: Vec<Template>,
    reduced: ReducedImage,
}

/// The compared part of the image, in px: centre and size.
#[derive(Clone, Copy, Debug)]
struct Patch {
    x: f64,
    y: f64,
    width: f64,
    height: f64,
}

impl Patch {
    /// The lower part of a track's box, with the smoothed width and height of the track, since single boxes
    /// extend into the background.
    fn of(track: &Track, focal_px: f64) -> Self {
        let PixelBox { x, y, width, height } = track.bounds;
        let [x, y, width, height] = [x, y, width, height].map(f64::from);
        let px = focal_px / track.distance_m();
        let (wide, high) = ((px * track.extent.width_m).min(width), (px * track.extent.height_m).min(height));
        let (middle, bottom) = (x + (width - 1.0) / 2.0, y + height - 1.0);
        Self { x: middle, y: bottom - high / 2.0, width: INNER_SHARE * wide, height: INNER_SHARE * high }
    }
}

impl ScaleChangeMeter {
    /// A meter for crops of images of up to `width` × `height` px.
    pub fn new(width: usize, height: usize) -> Self {
        let template = |_| Template {
            track: 0,
            time_ns: 0,
            last_used_ns: 0,
            distance_m: 0.0,
            factor: 1,
            points: Vec::with_capacity(POINTS),
        };
        let reduced = ReducedImage { pixels: Vec::with_capacity(width * height), ..ReducedImage::default() };
        Self { templates: (0..MAX_TRACKS).map(template).collect(), reduced }
    }

    /// Forgets all templates.
    pub fn reset(&mut self) {
        for template in &mut self.templates {
            (template.track, template.time_ns, template.last_used_ns) = (0, 0, 0);
            template.points.clear();
        }
    }

    /// Compares the image of a track at `time_ns` with its template, and replaces the template. `crop` starts
    /// at `origin` of the image. `None` if there is no template yet, if it is too recent, or if registration
    /// fails.
    fn measure(
        &mut self,
        track: &Track,
        time_ns: u64,
        patch: Patch,
        crop: GreyView<'_>,
        origin: (u32, u32),
    ) -> Option<ScaleRate> {
        let distance_m = track.distance_m();
        let Some(slot) = self.templates.iter().position(|v| v.track == track.id && v.time_ns <= time_ns)
        else {
            // Replaces the template that has not been requested for the longest time.
            let slot = (0..self.templates.len()).min_by_key(|&i| (self.templates[i].last_used_ns, i))?;
            self.store(slot, (track, patch), time_ns, crop, origin);
            return None;
        };
        self.templates[slot].last_used_ns = time_ns;
        let template = &self.templates[slot];
        let elapsed_ns = time_ns - template.time_ns;
        let expected = template.distance_m / distance_m;
        if elapsed_ns < INTERVAL_NS && expected < MAX_SCALE_CHANGE {
            return None;
        }
        let mut rate = None;
        if elapsed_ns <= MAX_AGE_NS && elapsed_ns > 0 {
            self.reduced.fill(crop, origin, template.factor);
            let start = Pose { x: patch.x, y: patch.y, scale: expected.clamp(0.7, 1.6) };
            let elapsed_s = elapsed_ns as f64 * 1e-9;
            rate = fit(&template.points, &self.reduced, start).map(|(scale, sigma)| {
                let per_s = (scale - 1.0) / elapsed_s;
                let sigma_per_s =
                    (sigma.max(MIN_SIGMA) / elapsed_s).hypot(per_s * DEPTH_OFFSET_M / distance_m);
                ScaleRate { per_s, sigma_per_s, interval_s: elapsed_s }
            });
        }
        self.store(slot, (track, patch), time_ns, crop, origin);
        rate
    }

    fn store(
        &mut self,
        slot: usize,
        (track, patch): (&Track, Patch),
        time_ns: u64,
        crop: GreyView<'_>,
        origin: (u32, u32),
    ) {
        let Patch { x: x0, y: y0, width, height } = patch;
        let step = (width / (COLUMNS - 1) as f64, height / (ROWS - 1) as f64);
        let factor = (step.0.max(step.1).round() as usize).max(1);
        self.reduced.fill(crop, origin, factor);
        let template = &mut self.templates[slot];
        (template.track, template.time_ns, template.last_used_ns) = (track.id, time_ns, time_ns);
        (template.distance_m, template.factor) = (track.distance_m(), factor);
        template.points.clear();
        let delta = 0.5 * factor as f64;
        for i in 0..POINTS {
            let x = (i % COLUMNS) as f64 * step.0 - width / 2.0;
            let y = (i / COLUMNS) as f64 * step.1 - height / 2.0;
            let at = |dx: f64, dy: f64| self.reduced.at(x0 + x + dx, y0 + y + dy);
            let (Some(value), Some(l), Some(r), Some(a), Some(b)) =
                (at(0.0, 0.0), at(-delta, 0.0), at(delta, 0.0), at(0.0, -delta), at(0.0, delta))
            else {
                continue;
            };
            let span = 2.0 * delta as f32;
            template.points.push(Point { x, y, value, slope: ((r - l) / span, (b - a) / span) });
        }
    }
}

/// Correlation of a template with an image at a pose, from one third of the points.
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

/// Registers a template to an image. Returns the scale and its standard deviation.
fn fit(points: &[Point], image: &ReducedImage, start: Pose) -> Option<(f64, f64)> {
    if points.len() < POINTS / 2 {
        return None;
    }
    // Boxes jump by one or two strips: start from the best of several shifts.
    let reach = points.iter().fold(0.0_f64, |m, p| m.max(p.x.abs()));
    let step = (0.08 * reach).max(1.5);
    let mut best = (f64::NEG_INFINITY, start);
    for k in 0..49 {
        let (dx, dy) = (f64::from(k % 7 - 3) * step, f64::from(k / 7 - 3) * step);
        let pose = Pose { x: start.x + dx, y: start.y + dy, ..start };
        if let Some(correlation) = correlation(points, image, pose)
            && correlation > best.0
        {
            best = (correlation, pose);
        }
    }
    let (correlation, mut pose) = best;
    if correlation < 0.5 {
        return None;
    }
    for _ in 0..MAX_ITERATIONS {
        let mut normal = SMatrix::<f64, 5, 5>::zeros();
        let mut right = SVector::<f64, 5>::zeros();
        let (mut sum, mut squares, mut inside) = (0.0, 0.0, 0.0);
        for p in points {
            let Some(v) = image.at(pose.x + pose.scale * p.x, pose.y + pose.scale * p.y) else {
                continue;
            };
            let v = f64::from(v);
            let (gx, gy) = (f64::from(p.slope.0), f64::from(p.slope.1));
            let row = SVector::<f64, 5>::new(gx, gy, gx * p.x + gy * p.y, p.value.into(), 1.0);
            normal.syger(1.0, &row, &row, 1.0);
            right += row * v;
            (sum, squares, inside) = (sum + v, squares + v * v, inside + 1.0);
        }
        if inside < MIN_INSIDE * points.len() as f64 {
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
        if ds.abs() < 5e-4 && dx.hypot(dy) < 0.03 {
            let errors = (squares - right.dot(&solution)).max(0.0);
            let spread = squares - sum * sum / inside;
            if errors > (1.0 - MIN_EXPLAINED_VARIANCE) * spread {
                return None;
            }
            let variance = errors / (inside - 5.0) * inverse[(2, 2)] / (gain * gain);
            return Some((pose.scale, CORRELATION_FACTOR * pose.scale * variance.max(0.0).sqrt()));
        }
    }
    None
}

impl Tracker {
    /// Measures the scale change of the nearest tracks and updates their filters: for each track that was
    /// detected in the frame at `time_ns`, `crop` returns its part of the left image and the position of that
    /// part.
    pub fn measure_scale_change<'a>(
        &mut self,
        meter: &mut ScaleChangeMeter,
        time_ns: u64,
        crop: impl Fn(&Track) -> Option<(GreyView<'a>, (u32, u32))>,
    ) {
        self.order.clear();
        for (i, track) in self.tracks.iter().enumerate() {
            let (b, z) = (&track.bounds, track.distance_m());
            let is_large = b.width >= MIN_PX.0 && b.height >= MIN_PX.1;
            let is_near = z >= MIN_DISTANCE_M
                && track.lateral.lateral_m().abs() <= MAX_LATERAL_M + track.extent.width_m / 2.0;
            if track.detection.is_some() && is_large && is_near {
                self.order.push((z, i as u32));
            }
        }
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, i) in self.order.iter().take(MAX_TRACKS) {
            let track = &mut self.tracks[i as usize];
            let Some((template, origin)) = crop(track) else { continue };
            let patch = Patch::of(track, self.rig.focal_px);
            if let Some(rate) = meter.measure(track, time_ns, patch, template, origin) {
                track.longitudinal.update_scale_rate(rate);
            }
        }
        self.drop_implausible();
    }
}

impl DistanceFilter {
    /// Updates the filter with a rate of scale change. Returns whether it was used; outliers are rejected.
    pub fn update_scale_rate(&mut self, rate: ScaleRate) -> bool {
        let (z, speed) = self.state();
        // −ż/z and its partial derivatives; ż is the mean of the interval, half of which is ago.
        let lag_s = rate.interval_s / 2.0;
        let mean = speed - self.acceleration_m_s2().map_or(0.0, |(value, _)| value * lag_s);
        let slopes = [mean / (z * z), -1.0 / z, lag_s / z];
        self.update_linearised(slopes, rate.per_s + mean / z, rate.sigma_per_s, GATE_SIGMAS, -1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::Region;
    use crate::rig::Rig;
    use crate::tracking::TrackerParameters;

    const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
    const SIZE: (usize, usize) = (640, 480);
    const PERIOD_NS: u64 = 80_000_000;

    /// Smooth texture on a plane, in metres.
    fn texture(x: f64, y: f64) -> f64 {
        let wave = |fx: f64, fy: f64, phase: f64| (fx * x + fy * y + phase).sin();
        let body = wave(7.0, 1.0, 0.3) + wave(-2.0, 9.0, 1.0) + wave(13.0, 11.0, 2.0) + wave(3.0, -5.0, 4.0);
        110.0 + 22.0 * body
    }

    /// Image and region of the back of a car, 1.8 × 1.5 m, at `z` metres in front of a grey wall.
    fn image(z: f64, lateral_m: f64, random: &mut fastrand::Rng) -> (Vec<u8>, Region) {
        let mut pixels = vec![0; SIZE.0 * SIZE.1];
        let px = RIG.focal_px / z;
        let (left, right) = (RIG.cx_px + px * (lateral_m - 0.9), RIG.cx_px + px * (lateral_m + 0.9));
        let (top, bottom) = (RIG.cy_px - px * 0.25, RIG.cy_px + px * 1.25);
        for (i, v) in pixels.iter_mut().enumerate() {
            let (u, w) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let inside = u >= left && u < right && w >= top && w < bottom;
            let value = if inside {
                texture((u - RIG.cx_px) / px - lateral_m, (w - RIG.cy_px) / px)
            } else {
                90.0 + 20.0 * (u * 0.05).sin()
            };
            let noise = (0..4).map(|_| random.f64()).sum::<f64>() - 2.0;
            *v = (value + 3.0 * noise).clamp(0.0, 255.0) as u8;
        }
        // Box sides are quantised to strips of four columns, and jump.
        let strip = |v: f64, random: &mut fastrand::Rng| {
            ((v / 4.0).round() as i32 * 4 + random.i32(-1..2) * 2).max(0) as u32
        };
        let (x, y) = (strip(left, random), strip(top, random));
        let bounds = PixelBox { x, y, width: strip(right, random) - x, height: strip(bottom, random) - y };
        let disparity_px = RIG.disparity_px(z) + 0.12 * (0..12).map(|_| random.f64()).sum::<f64>() - 0.72;
        let region = Region {
            bounds,
            disparity_px,
            disparity_sigma_px: 0.12,
            distance_m: RIG.distance_m(disparity_px),
            lateral_m,
            width_m: 1.8,
            height_m: 1.5,
            inset_m: [0.0; 2],
            pixels: 500,
            confidence: 0.9,
            evidence: 4.0,
        };
        (pixels, region)
    }

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

    /// Largest error of the time to collision from 2.5 s down to 0.5 s: relative, and in standard deviations.
    fn approach(seed: u64, with_scale_change: bool) -> (f64, f64) {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut tracker = Tracker::new(TrackerParameters::default(), RIG, SIZE);
        let mut meter = ScaleChangeMeter::new(SIZE.0, SIZE.1);
        let (mut z, closing) = (52.0, 13.9);
        let mut worst = (0.0_f64, 0.0_f64);
        for frame in 0.. {
            z -= closing * 0.08;
            if z / closing < 0.5 {
                break;
            }
            let (pixels, region) = image(z, 0.1, &mut random);
            tracker.update(frame * PERIOD_NS, &[region]);
            assert_eq!(tracker.tracks().len(), 1);
            if with_scale_change {
                let image = GreyView::new(&pixels, SIZE.0, SIZE.1, SIZE.0).expect("valid size");
                tracker.measure_scale_change(&mut meter, frame * PERIOD_NS, |_| Some((image, (0, 0))));
            }
            let truth = z / closing;
            if truth <= 2.5 {
                let Some(ttc) = tracker.tracks()[0].time_to_collision() else {
                    worst.0 = 1.0;
                    continue;
                };
                worst.0 = worst.0.max((ttc.seconds - truth).abs() / truth);
                worst.1 = worst.1.max((ttc.seconds - truth).abs() / ttc.sigma_s);
            }
        }
        worst
    }

    #[test]
    fn scale_change_improves_the_time_to_collision_at_long_range() {
        let runs = |with| -> Vec<(f64, f64)> {
            let mut all: Vec<(f64, f64)> = (0..12).map(|seed| approach(seed, with)).collect();
            all.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            all
        };
        let (without, with) = (runs(false), runs(true));
        let most = with.iter().fold(0.0_f64, |m, r| m.max(r.1));
        println!(
            "50 km/h, 0.12 px, seeds 0 to 11: worst TTC error of a run from 2.5 s down, median and worst run: \
             {:.1} and {:.1} % by disparity, {:.1} and {:.1} % with growth, at most {most:.1} stated deviations",
            100.0 * without[6].0,
            100.0 * without[11].0,
            100.0 * with[6].0,
            100.0 * with[11].0
        );
        assert!(with[11].0 < 0.10 && with[6].0 < 0.6 * without[6].0);
        assert!(most < 4.0);
    }

    #[test]
    fn a_failed_registration_changes_nothing() {
        let mut random = fastrand::Rng::with_seed(1);
        let (first, region) = image(25.0, 0.0, &mut random);
        let noise: Vec<u8> = (0..SIZE.0 * SIZE.1).map(|_| random.u8(..)).collect();
        let flat = vec![90; SIZE.0 * SIZE.1];
        for second in [&noise, &flat] {
            let mut tracker = Tracker::new(TrackerParameters::default(), RIG, SIZE);
            let mut meter = ScaleChangeMeter::new(SIZE.0, SIZE.1);
            for (frame, pixels) in [&first, second].into_iter().enumerate() {
                let time_ns = frame as u64 * 5 * PERIOD_NS;
                let image = GreyView::new(pixels, SIZE.0, SIZE.1, SIZE.0).expect("valid size");
                tracker.update(time_ns, &[region]);
                let before = tracker.tracks()[0].longitudinal;
                tracker.measure_scale_change(&mut meter, time_ns, |_| Some((image, (0, 0))));
                assert_eq!(tracker.tracks()[0].longitudinal, before, "frame {frame}");
            }
        }
        // A crop that hardly contains the box.
        let small = GreyView::new(&first, 20, 12, SIZE.0).expect("valid size");
        let mut tracker = Tracker::new(TrackerParameters::default(), RIG, SIZE);
        let mut meter = ScaleChangeMeter::new(SIZE.0, SIZE.1);
        for frame in 0..9 {
            tracker.update(frame * PERIOD_NS, &[region]);
            tracker.measure_scale_change(&mut meter, frame * PERIOD_NS, |_| Some((small, (300, 230))));
        }
        assert_eq!(tracker.tracks().len(), 1);
    }
}
