//! Disparities of stixels and regions, refined in both images.
//!
//! The sub-pixel fit of the matcher pulls disparities to whole pixels, by up to a quarter of a pixel (pixel locking: Shimizu and
//! Okutomi, 2001). At 1.75 px that is a seventh of the distance, and a thing that comes nearer seems to wait at a whole pixel and to
//! jump from there to the next one. Its windows also spread what is near over what is beside it. The pixels of a stixel, and those of
//! a region's near side, are therefore registered once more, all together by one shift (Lucas and Kanade, 1981).
//!
//! The shift is that at which the differences between both images do not correlate with the gradient of the left one: noise
//! correlates with neither. The right image is interpolated by cubic convolution, whose phase is nearly right; a constant difference of
//! brightness is allowed for, and large differences, as of reflections and occlusions, count less.

use super::stixels::{STRIP_COLUMNS, Stixel, Stixels};
use crate::image::GreyView;
use crate::region::{DEPTH_BLUR_PX, SHAPE_M};
use crate::rig::Rig;

/// Disparities of regions above this are not refined, in px: pixel locking is a small part of them.
const MAX_DISPARITY_PX: f64 = 16.0;
/// The same for stixels, in px.
const MAX_STIXEL_DISPARITY_PX: f32 = 8.0;
/// What is nearer than the mean of a near side by more than this, in metres, is noise.
const MAX_PROTRUSION_M: f64 = 0.3;
/// Largest number of parts of rows, each as wide as a strip, that are compared.
pub(super) const MAX_PARTS: usize = 256;
/// Fewest.
const MIN_PARTS: usize = 10;
/// Largest number of rows of a stixel that are compared.
const MAX_STIXEL_ROWS: usize = 32;
/// Largest change of a stixel's disparity, in px: beside what is near, the matcher gives what is behind it nearly the same disparity;
const MAX_STIXEL_CHANGE_PX: f32 = 1.0;
/// and its largest standard deviation, in px.
const MAX_STIXEL_SIGMA_PX: f64 = 0.3;
/// Standard deviation of the map's error against which the change is weighed, in px; less than the 0.14 of pixel locking alone, as the
/// error of a registration is not noise alone.
const LOCKING_SIGMA_PX: f64 = 0.1;
/// Regions of at least one strip more than this are compared without their outermost strips: the windows of the matcher spread what is
/// near over what is behind it.
const MIN_SPAN_STRIPS: u32 = 3;
/// Largest change of the disparity, in px: twice what pixel locking makes. More is another surface.
const MAX_CHANGE_PX: f32 = 0.6;
/// Largest change in one iteration, in px.
const MAX_STEP_PX: f32 = 0.3;
/// Iterations, and the change in px below which they end.
const ITERATIONS: usize = 8;
const SETTLED_PX: f32 = 0.004;
/// Difference of brightness that counts half, in grey levels.
const HALF_WEIGHT: f32 = 15.0;
/// Smallest variance of the gradient, in squared grey levels per px.
const MIN_TEXTURE: f32 = 1e-3;
/// Standard deviation of the shift as a multiple of that for independent noise: smoothing makes neighbours alike, and rows of one edge
/// have the same error.
const SIGMA_FACTOR: f64 = 2.0;
/// Largest one that is as good as what the matcher knows, in px: errors between -1/4 and 1/4 px have this standard deviation.
const MAX_SIGMA_PX: f64 = 0.14;
/// What is added to it, in px: what is seen through windows, and what was spread over the background.
const RESIDUAL_PX: f64 = 0.05;

/// Limits within which a registration counts: largest change and largest standard deviation, both in px.
#[derive(Clone, Copy, Debug)]
struct Limits {
    change_px: f32,
    sigma_px: f64,
}

/// A part of a row, as wide as a strip: row and strip.
pub(super) type Part = [u16; 2];

/// Refines the disparity of the near side of a region, whose stixels are `members`. Returns it and its standard deviation, both in px;
/// `None` where the images do not tell. `parts` is a workspace.
pub(super) fn refine<'a>(
    parts: &mut Vec<Part>,
    stixels: &Stixels,
    members: impl Iterator<Item = &'a Stixel> + Clone,
    images: [GreyView<'_>; 2],
    near_px: f64,
    rig: &Rig,
) -> Option<(f64, f64)> {
    if near_px > MAX_DISPARITY_PX {
        return None;
    }
    let mean_px = collect(parts, stixels, members, near_px);
    let limits = Limits { change_px: MAX_CHANGE_PX, sigma_px: MAX_SIGMA_PX };
    let (refined_px, sigma_px) = register(images, parts, mean_px, limits)?;
    let px_of = |depth_m: f64| depth_m * near_px * near_px / rig.disparity_px(1.0);
    // The near side is before the mean of what was compared.
    let before_px = (near_px - mean_px).clamp(0.0, px_of(MAX_PROTRUSION_M));
    Some((refined_px + before_px, sigma_px.hypot(RESIDUAL_PX).hypot(px_of(SHAPE_M))))
}

/// Refines the disparities of stixels in both images, and those of their rows. `parts` is a workspace.
pub(super) fn refine_stixels(stixels: &mut Stixels, parts: &mut Vec<Part>, images: [GreyView<'_>; 2]) {
    for i in 0..stixels.list().len() {
        let stixel = stixels.list()[i];
        if stixel.disparity_px <= MAX_STIXEL_DISPARITY_PX
            && let Some(change_px) =
                refined_change_px(parts, stixels.depths(stixel.strip as usize), &stixel, images)
        {
            stixels.shift(i, change_px, |depth| is_of(&stixel, depth));
        }
    }
}

/// Whether a row with this disparity, in 1/256 px, may show the surface of a stixel, as far as it may be refined; within its rows there
/// may be others, as behind windows.
fn is_of(stixel: &Stixel, depth: u16) -> bool {
    depth > 0 && (f32::from(depth) / 256.0 - stixel.disparity_px).abs() <= MAX_STIXEL_CHANGE_PX
}

/// By how much the disparity of a stixel changes, in px, if it is refined; `None` where the images do not tell. `depths`: disparities of
/// its strip, row by row, in 1/256 px; 0 = unknown. `parts` is a workspace.
fn refined_change_px(
    parts: &mut Vec<Part>,
    depths: &[u16],
    stixel: &Stixel,
    images: [GreyView<'_>; 2],
) -> Option<f32> {
    let rows = usize::from(stixel.top)..=usize::from(stixel.bottom);
    let step = rows.clone().count().div_ceil(MAX_STIXEL_ROWS);
    let mut sum = 0_u32;
    parts.clear();
    for y in rows.step_by(step).filter(|y| is_of(stixel, depths[*y])) {
        parts.push([y as u16, stixel.strip as u16]);
        sum += u32::from(depths[y]);
    }
    let mean_px = f64::from(sum) / (256.0 * parts.len().max(1) as f64);
    let limits = Limits { change_px: MAX_STIXEL_CHANGE_PX, sigma_px: MAX_STIXEL_SIGMA_PX };
    let (refined_px, sigma_px) = register(images, parts, mean_px, limits)?;
    let (locked, unsure) = (LOCKING_SIGMA_PX * LOCKING_SIGMA_PX, sigma_px * sigma_px);
    Some((locked / (locked + unsure) * (refined_px - mean_px)) as f32)
}

/// Collects the parts of rows in which stixels have a disparity like this one, in px; evenly, if there are too many. Returns the mean of
/// their disparities, in px; 0 if there are none.
fn collect<'a>(
    parts: &mut Vec<Part>,
    stixels: &Stixels,
    members: impl Iterator<Item = &'a Stixel> + Clone,
    disparity_px: f64,
) -> f64 {
    let [first, last] = members.clone().fold([u32::MAX, 0], |[a, b], s| [a.min(s.strip), b.max(s.strip)]);
    let is_wide = last.saturating_sub(first) >= MIN_SPAN_STRIPS;
    let inner = if is_wide { first + 1..=last - 1 } else { first..=last };
    let members = members.filter(|s| inner.contains(&s.strip));
    let rows: usize = members.clone().map(|s| usize::from(s.bottom - s.top) + 1).sum();
    let step = rows.div_ceil(MAX_PARTS).max(1);
    // Rows of the stixels before, so that each is as likely to be compared.
    let mut before = 0_usize;
    let is_near = |depth: u16| depth > 0 && (f64::from(depth) / 256.0 - disparity_px).abs() <= DEPTH_BLUR_PX;
    let mut sum = 0_u32;
    parts.clear();
    for stixel in members {
        let depths = stixels.depths(stixel.strip as usize);
        let (top, bottom) = (usize::from(stixel.top), usize::from(stixel.bottom));
        let skipped = before.next_multiple_of(step) - before;
        before += bottom - top + 1;
        for y in (top + skipped..=bottom).step_by(step) {
            if parts.len() < MAX_PARTS && is_near(depths[y]) {
                parts.push([y as u16, stixel.strip as u16]);
                sum += u32::from(depths[y]);
            }
        }
    }
    f64::from(sum) / (256.0 * parts.len().max(1) as f64)
}

/// Weighted sums of an iteration.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weight: f32,
    difference: f32,
    gradient: f32,
    both: f32,
    gradient2: f32,
    difference2: f32,
}

/// A number for each column of a part.
type Columns = [f32; STRIP_COLUMNS];

/// Disparity and its standard deviation in px, at which these parts of the left image fit the right one best; `None` where the images
/// do not tell, or tell of something else.
fn register(
    [left, right]: [GreyView<'_>; 2],
    parts: &[Part],
    start_px: f64,
    limits: Limits,
) -> Option<(f64, f64)> {
    if parts.len() < MIN_PARTS {
        return None;
    }
    let start_px = start_px as f32;
    let (mut disparity_px, mut offset) = (start_px, 0.0);
    for _ in 0..ITERATIONS {
        let sums = compare([left, right], parts, disparity_px, offset);
        if sums.weight < (MIN_PARTS * STRIP_COLUMNS) as f32 / 2.0 {
            return None;
        }
        let covariance = sums.both - sums.gradient * sums.difference / sums.weight;
        let variance = sums.gradient2 - sums.gradient * sums.gradient / sums.weight;
        let has_texture = variance > MIN_TEXTURE * sums.weight;
        if !has_texture {
            return None;
        }
        offset = sums.difference / sums.weight;
        let shift_px = (covariance / variance).clamp(-MAX_STEP_PX, MAX_STEP_PX);
        disparity_px -= shift_px;
        // A comparison with NaN is false.
        let is_like = (disparity_px - start_px).abs() <= limits.change_px && disparity_px > 0.0;
        if !is_like {
            return None;
        }
        if shift_px.abs() < SETTLED_PX {
            let noise = (sums.difference2 / sums.weight - offset * offset).max(0.1);
            let sigma_px = SIGMA_FACTOR * f64::from(noise / variance).sqrt();
            return (sigma_px <= limits.sigma_px).then_some((f64::from(disparity_px), sigma_px));
        }
    }
    None
}

/// Compares both images at a disparity, where the brightness differs by `offset`.
fn compare([left, right]: [GreyView<'_>; 2], parts: &[Part], disparity_px: f32, offset: f32) -> Sums {
    let whole = disparity_px.ceil();
    let taps = smoothed(cubic(whole - disparity_px));
    let whole = whole as usize;
    // By column, so that the columns of a part are added up side by side.
    let mut sums = [Columns::default(); 6];
    for &[y, strip] in parts {
        let (y, first) = (usize::from(y), usize::from(strip) * STRIP_COLUMNS);
        // What gradient and interpolation need on both sides.
        let columns = |from: Option<usize>, reach: usize| from.map(|from| from..from + STRIP_COLUMNS + reach);
        let (of_left, of_right) =
            (columns(first.checked_sub(2), 4), columns(first.checked_sub(whole + 2), 5));
        let (Some(l), Some(r)) =
            (of_left.and_then(|c| left.row(y).get(c)), of_right.and_then(|c| right.row(y).get(c)))
        else {
            continue;
        };
        let l: [f32; STRIP_COLUMNS + 4] = std::array::from_fn(|i| f32::from(l[i]));
        let r: [f32; STRIP_COLUMNS + 5] = std::array::from_fn(|i| f32::from(r[i]));
        for i in 0..STRIP_COLUMNS {
            let here = 0.25 * (l[i + 1] + 2.0 * l[i + 2] + l[i + 3]);
            let gradient = 0.125 * (l[i + 4] - l[i] + 2.0 * (l[i + 3] - l[i + 1]));
            let there = taps[0] * r[i]
                + taps[1] * r[i + 1]
                + taps[2] * r[i + 2]
                + taps[3] * r[i + 3]
                + taps[4] * r[i + 4]
                + taps[5] * r[i + 5];
            let difference = here - there;
            let unlike = (difference - offset) / HALF_WEIGHT;
            let weight = 1.0 / (1.0 + unlike * unlike);
            sums[0][i] += weight;
            sums[1][i] += weight * difference;
            sums[2][i] += weight * gradient;
            sums[3][i] += weight * gradient * difference;
            sums[4][i] += weight * gradient * gradient;
            sums[5][i] += weight * difference * difference;
        }
    }
    let [weight, difference, gradient, both, gradient2, difference2] = sums.map(|sum| sum.iter().sum());
    Sums { weight, difference, gradient, both, gradient2, difference2 }
}

/// Weights of four neighbours at a place this share of a column behind the second one: cubic convolution (Keys, 1981).
fn cubic(share: f32) -> [f32; 4] {
    let (s, s2, s3) = (share, share * share, share * share * share);
    [-0.5 * s + s2 - 0.5 * s3, 1.0 - 2.5 * s2 + 1.5 * s3, 0.5 * s + 2.0 * s2 - 1.5 * s3, 0.5 * (s3 - s2)]
}

/// The same of an image smoothed by the binomial filter 1 2 1.
fn smoothed(taps: [f32; 4]) -> [f32; 6] {
    let at = |i: usize| taps.get(i.wrapping_sub(2)).copied().unwrap_or(0.0);
    std::array::from_fn(|i| (at(i) + 2.0 * at(i + 1) + at(i + 2)) / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (96, 40);

    /// A pair that shows a surface at this disparity, with texture of all lengths from three px on, noise, and a right image that is
    /// brighter by `brighter` grey levels.
    fn pair(seed: u64, disparity_px: f64, contrast: f64, brighter: f64) -> [Vec<u8>; 2] {
        let mut random = fastrand::Rng::with_seed(seed);
        let waves: Vec<[f64; 3]> =
            (0..40).map(|_| [0.05 + 2.0 * random.f64(), 6.3 * random.f64(), 0.8 * random.f64()]).collect();
        let mut image = |shift_px: f64, brighter: f64| {
            let mut grey = |x: usize, y: usize| {
                let at = x as f64 + shift_px;
                let wave = |[rate, phase, slope]: &[f64; 3]| (rate * at + slope * y as f64 + phase).sin();
                let texture = contrast * waves.iter().map(wave).sum::<f64>() / (waves.len() as f64).sqrt();
                let noise = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
                (120.0 + texture + brighter + 2.0 * noise).round().clamp(0.0, 255.0) as u8
            };
            (0..SIZE.0 * SIZE.1).map(|i| grey(i % SIZE.0, i / SIZE.0)).collect::<Vec<u8>>()
        };
        [image(0.0, 0.0), image(disparity_px, brighter)]
    }

    /// What [`register`] finds from `start_px` on, in strips 4 to 19 of all rows.
    fn registered(pair: &[Vec<u8>; 2], start_px: f64) -> Option<(f64, f64)> {
        let view = |bytes| GreyView::new(bytes, SIZE.0, SIZE.1, SIZE.0).unwrap();
        let parts: Vec<Part> =
            (0..SIZE.1 as u16).flat_map(|y| (4..20).map(move |strip| [y, strip])).collect();
        let limits = Limits { change_px: MAX_CHANGE_PX, sigma_px: MAX_SIGMA_PX };
        register([view(&pair[0]), view(&pair[1])], &parts, start_px, limits)
            .map(|(px, sigma_px)| (px, sigma_px.hypot(RESIDUAL_PX)))
    }

    #[test]
    fn a_shift_is_found_between_whole_pixels_wherever_the_matcher_locks_to() {
        let (mut worst_px, mut squares) = (0.0_f64, 0.0);
        for seed in 0..5 {
            for step in 0..20 {
                let truth_px = 1.5 + 0.05 * f64::from(step);
                let images = pair(seed, truth_px, 25.0, 12.0);
                let (found_px, sigma_px) = registered(&images, truth_px.round()).unwrap();
                worst_px = worst_px.max((found_px - truth_px).abs());
                squares += ((found_px - truth_px) / sigma_px).powi(2) / 100.0;
            }
        }
        println!("worst error {worst_px:.3} px, mean square {squares:.2} of its variance");
        assert!(worst_px < 0.04 && squares < 0.6, "{worst_px} {squares}");
    }

    #[test]
    fn a_surface_without_texture_tells_nothing_or_says_so() {
        let flat = [vec![90_u8; SIZE.0 * SIZE.1], vec![90; SIZE.0 * SIZE.1]];
        assert_eq!(registered(&flat, 2.0), None);
        // A ramp in both images, of which rounding alone makes a variance.
        let ramp = |by: u8| (0..SIZE.0 * SIZE.1).map(|i| (i % SIZE.0) as u8 + by).collect::<Vec<u8>>();
        assert_eq!(registered(&[ramp(20), ramp(23)], 2.0), None);
        let mut told = 0;
        for seed in 0..20 {
            let contrast = 1.0 + 0.2 * seed as f64;
            if let Some((found_px, sigma_px)) = registered(&pair(seed, 2.3, contrast, 0.0), 2.0) {
                told += 1;
                let error_px = (found_px - 2.3).abs();
                assert!(sigma_px < 0.16 && error_px < 2.5 * sigma_px, "{seed}: {error_px} {sigma_px}");
            }
        }
        println!("{told} of 20 faint surfaces tell");
        assert!((5..20).contains(&told), "{told}");
    }

    #[test]
    fn what_is_far_from_the_start_is_something_else() {
        assert_eq!(registered(&pair(1, 3.5, 25.0, 0.0), 2.0), None);
        // Nothing is compared beyond the border of the right image.
        let view = |bytes| GreyView::new(bytes, SIZE.0, SIZE.1, SIZE.0).unwrap();
        let [left, right] = pair(1, 2.0, 25.0, 0.0);
        let border: Vec<Part> = (0..SIZE.1 as u16).map(|y| [y, 0]).collect();
        let limits = Limits { change_px: 1.0, sigma_px: 1.0 };
        assert_eq!(register([view(&left), view(&right)], &border, 2.0, limits), None);
    }

    #[test]
    fn a_stixel_is_refined_as_far_as_the_images_tell() {
        let stixel =
            Stixel { strip: 8, top: 4, bottom: 35, rows: 32, disparity_px: 2.0, ..Stixel::default() };
        let depths = [512_u16; SIZE.1];
        let change_px = |pair: &[Vec<u8>; 2]| {
            let images = [&pair[0], &pair[1]].map(|b| GreyView::new(b, SIZE.0, SIZE.1, SIZE.0).unwrap());
            refined_change_px(&mut Vec::new(), &depths, &stixel, images)
        };
        let mean = |truth_px: f64, contrast: f64| {
            let all = (0..20).filter_map(|seed| change_px(&pair(seed, truth_px, contrast, 12.0)));
            let all: Vec<f32> = all.collect();
            (all.len(), f64::from(all.iter().sum::<f32>()) / all.len().max(1) as f64)
        };
        for truth_px in [1.4, 1.75, 2.3, 2.8] {
            let (count, clear_px) = mean(truth_px, 40.0);
            assert!(
                count >= 18 && (clear_px - (truth_px - 2.0)).abs() < 0.1,
                "{truth_px}: {count} {clear_px}"
            );
        }
        let (clear_px, faint_px) = (mean(2.3, 40.0).1, mean(2.3, 5.0).1);
        assert!(faint_px > 0.0 && faint_px < 0.8 * clear_px, "{faint_px} of {clear_px}");
        assert_eq!(mean(3.2, 40.0).0, 0, "another surface");
        assert_eq!(mean(2.3, 0.0).0, 0, "noise alone");
        let images = pair(1, 2.3, 40.0, 0.0);
        let views = images.each_ref().map(|b| GreyView::new(b, SIZE.0, SIZE.1, SIZE.0).unwrap());
        let rows = |top, bottom, depths: &[u16]| {
            let mut parts = Vec::new();
            let stixel = Stixel { top, bottom, ..stixel };
            refined_change_px(&mut parts, depths, &stixel, views)
                .map(|change_px| (parts.len(), change_px > 0.1))
        };
        assert_eq!(rows(0, 39, &depths), Some((20, true)), "every second row");
        assert_eq!(rows(0, 8, &depths), None, "too few rows");
        assert_eq!(rows(0, 39, &[0; SIZE.1]), None, "nothing is known");
    }

    #[test]
    fn interpolation_keeps_the_brightness() {
        for share in [0.0, 0.3, 0.99] {
            assert!((cubic(share).iter().sum::<f32>() - 1.0).abs() < 1e-6);
            assert!((smoothed(cubic(share)).iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
        assert_eq!(smoothed(cubic(0.0)), [0.0, 0.25, 0.5, 0.25, 0.0, 0.0]);
    }
}
