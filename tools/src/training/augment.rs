//! Data augmentation: windows cut from images, varied in position, size, orientation, lighting and sharpness.

use fastrand::Rng;
use perception::image::GreyView;

/// A rectangle of an image, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl Part {
    /// The whole image.
    pub fn whole(picture: GreyView<'_>) -> Self {
        Self { x: 0.0, y: 0.0, width: picture.width() as f64, height: picture.height() as f64 }
    }
}

/// Strength of the augmentation; all 0 leaves a patch unchanged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variation {
    /// Maximum shift, as a share of the window.
    pub shift: f64,
    /// Maximum change of size, as a share.
    pub scale: f64,
    /// Whether to mirror half of the windows.
    pub mirror: bool,
    /// Maximum change of gamma, and maximum loss of contrast at either end as a share of half the range.
    pub light: f64,
    /// Maximum blur, standard deviation in window pixels; noise up to 4 × this many grey levels.
    pub blur: f64,
}

impl Variation {
    /// Default strength of the trainer.
    pub const USUAL: Self = Self { shift: 0.04, scale: 0.08, mirror: true, light: 0.25, blur: 0.7 };
    /// No augmentation.
    pub const NONE: Self = Self { shift: 0.0, scale: 0.0, mirror: false, light: 0.0, blur: 0.0 };

    /// Scales the strength; 0 is none.
    #[must_use]
    pub fn times(self, times: f64) -> Self {
        Self {
            shift: self.shift * times,
            scale: self.scale * times,
            mirror: self.mirror && times > 0.0,
            light: (self.light * times).min(1.0),
            blur: self.blur * times,
        }
    }
}

/// Resampling of an image to the size of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// Area averaging, as used to evaluate patches.
    Area,
    /// Bilinear interpolation, as used by the detector.
    Bilinear,
}

/// Pixels covered by an interval, each with its covered length.
fn covered(from: f64, to: f64, limit: usize) -> impl Iterator<Item = (usize, f32)> {
    let last = limit as i64 - 1;
    let (first, end) = (from.floor() as i64, (to.ceil() as i64).max(from.floor() as i64 + 1));
    (first..end).map(move |i| {
        let share = (to.min(i as f64 + 1.0) - from.max(i as f64)).max(0.0);
        // The border is replicated.
        (i.clamp(0, last) as usize, share as f32)
    })
}

/// A rectangle of an image resampled to the window, `width` × `height` pixels.
pub fn window(
    picture: GreyView<'_>,
    part: Part,
    sampling: Sampling,
    (width, height): (usize, usize),
    out: &mut Vec<u8>,
) {
    let (dx, dy) = (part.width / width as f64, part.height / height as f64);
    out.clear();
    // Under magnification areas are smaller than a pixel and would produce blocks.
    if sampling == Sampling::Bilinear || dx <= 1.0 || dy <= 1.0 {
        return bilinear(picture, part, (width, height), out);
    }
    let axis = |from: f64, step: f64, count: usize, limit: usize| -> Vec<Vec<(usize, f32)>> {
        (0..count)
            .map(|i| covered(from + i as f64 * step, from + (i + 1) as f64 * step, limit).collect())
            .collect()
    };
    let columns = axis(part.x, dx, width, picture.width());
    let rows = axis(part.y, dy, height, picture.height());
    let whole = (dx * dy) as f32;
    for row in &rows {
        for column in &columns {
            let mut sum = 0.0_f32;
            for &(y, share_y) in row {
                let line = picture.row(y);
                let along: f32 = column.iter().map(|&(x, share)| f32::from(line[x]) * share).sum();
                sum += along * share_y;
            }
            out.push((sum / whole + 0.5) as u8);
        }
    }
}

fn bilinear(picture: GreyView<'_>, part: Part, (width, height): (usize, usize), out: &mut Vec<u8>) {
    // The pixel at or before a position, the next one, and the weight of the latter.
    let place = |from: f64, side: f64, i: usize, count: usize, limit: usize| {
        let at = (from + (i as f64 + 0.5) * side / count as f64 - 0.5).clamp(0.0, limit as f64 - 1.0);
        let first = at as usize;
        (first, (first + 1).min(limit - 1), (at - first as f64) as f32)
    };
    let columns: Vec<(usize, usize, f32)> =
        (0..width).map(|x| place(part.x, part.width, x, width, picture.width())).collect();
    for y in 0..height {
        let (upper, lower, down) = place(part.y, part.height, y, height, picture.height());
        let (upper, lower) = (picture.row(upper), picture.row(lower));
        out.extend(columns.iter().map(|&(left, right, across)| {
            let mix = |row: &[u8]| {
                let (a, b) = (f32::from(row[left]), f32::from(row[right]));
                a + (b - a) * across
            };
            let (a, b) = (mix(upper), mix(lower));
            (a + (b - a) * down + 0.5) as u8
        }));
    }
}

fn within(random: &mut Rng, most: f64) -> f64 {
    (random.f64() * 2.0 - 1.0) * most
}

/// An augmented window of a rectangle. Equal random numbers give equal windows.
pub fn vary(
    picture: GreyView<'_>,
    part: Part,
    variation: &Variation,
    random: &mut Rng,
    (width, height): (usize, usize),
    out: &mut Vec<u8>,
) {
    let size = 1.0 + within(random, variation.scale);
    let (new_width, new_height) = (part.width * size, part.height * size);
    let moved = Part {
        x: part.x + (part.width - new_width) / 2.0 + within(random, variation.shift) * part.width,
        y: part.y + (part.height - new_height) / 2.0 + within(random, variation.shift) * part.height,
        width: new_width,
        height: new_height,
    };
    let sampling = if random.bool() { Sampling::Area } else { Sampling::Bilinear };
    window(picture, moved, sampling, (width, height), out);
    if variation.mirror && random.bool() {
        for row in out.chunks_exact_mut(width) {
            row.reverse();
        }
    }
    relight(variation, random, width, out);
}

/// Varies lighting and sharpness of half of the windows, in place. Applied equally to positives and negatives;
/// otherwise the trees would separate them by it.
pub fn relight(variation: &Variation, random: &mut Rng, width: usize, out: &mut [u8]) {
    if random.bool() {
        return;
    }
    if variation.blur > 0.0 && random.bool() {
        blur(out, width, random.f64() * variation.blur);
    }
    let noise = random.f64() * variation.blur * 4.0;
    if variation.light > 0.0 || noise > 0.0 {
        let gamma = 1.0 + within(random, variation.light);
        // Lower contrast at any position in the range, without clipping at black or white.
        let low = random.f64() * variation.light * 127.0;
        let high = 255.0 - random.f64() * variation.light * 127.0;
        let table: Vec<f64> =
            (0..256).map(|v| (f64::from(v) / 255.0).powf(gamma) * (high - low) + low).collect();
        for v in out.iter_mut() {
            let noise = if noise > 0.0 { within(random, noise) } else { 0.0 };
            // Saturating cast: below 0 becomes 0, above 255 becomes 255.
            *v = (table[usize::from(*v)] + noise + 0.5) as u8;
        }
    }
}

/// Reduces the contrast of a third of the windows strongly: dark or uniform areas are never objects, and their
/// equal grey levels occur nowhere else.
pub fn fade(variation: &Variation, random: &mut Rng, out: &mut [u8]) {
    if variation.light <= 0.0 || random.u8(0..3) > 0 {
        return;
    }
    let contrast = 0.02_f64.powf(random.f64());
    // Towards black more often than towards other grey levels.
    let level = if random.bool() { 0.0 } else { random.f64() * 255.0 };
    let noise = if random.bool() { random.f64() * 3.0 } else { 0.0 };
    for v in out.iter_mut() {
        let noise = if noise > 0.0 { within(random, noise) } else { 0.0 };
        *v = (level + (f64::from(*v) - level) * contrast + noise + 0.5) as u8;
    }
}

/// Gaussian blur over 3 pixels, along rows and columns.
fn blur(pixels: &mut [u8], width: usize, sigma_px: f64) {
    let side = (-0.5 / sigma_px.max(0.1).powi(2)).exp();
    let (middle, side) = (1.0 / (1.0 + 2.0 * side), side / (1.0 + 2.0 * side));
    let height = pixels.len() / width;
    let source: Vec<f64> = pixels.iter().map(|&v| f64::from(v)).collect();
    let mut along = source.clone();
    for y in 0..height {
        for x in 0..width {
            let at = |x: usize| source[y * width + x];
            along[y * width + x] =
                middle * at(x) + side * (at(x.saturating_sub(1)) + at((x + 1).min(width - 1)));
        }
    }
    for y in 0..height {
        for x in 0..width {
            let at = |y: usize| along[y * width + x];
            let value = middle * at(y) + side * (at(y.saturating_sub(1)) + at((y + 1).min(height - 1)));
            pixels[y * width + x] = value.round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_of_the_same_size_is_the_picture() {
        let data: Vec<u8> = (0..48).map(|i| i * 5).collect();
        let picture = GreyView::new(&data, 8, 6, 8).expect("a picture");
        for sampling in [Sampling::Area, Sampling::Bilinear] {
            let mut out = Vec::new();
            window(picture, Part::whole(picture), sampling, (8, 6), &mut out);
            assert_eq!(out, data);
            vary(picture, Part::whole(picture), &Variation::NONE, &mut Rng::with_seed(1), (8, 6), &mut out);
            assert_eq!(out, data);
        }
    }

    #[test]
    fn areas_are_means_of_what_they_cover() {
        let data = [10, 20, 30, 40, 50, 60];
        let picture = GreyView::new(&data, 6, 1, 6).expect("a picture");
        let mut out = Vec::new();
        // A single row, doubled, so that both dimensions are reduced.
        let doubled: Vec<u8> = data.iter().chain(&data).copied().collect();
        let tall = GreyView::new(&doubled, 6, 2, 6).expect("a picture");
        window(tall, Part::whole(tall), Sampling::Area, (4, 1), &mut out);
        // 1.5 pixels each: (10 + 20/2)/1.5, (20/2 + 30)/1.5, …
        assert_eq!(out, [13, 27, 43, 57]);
        window(picture, Part { x: -2.0, y: 0.0, width: 3.0, height: 1.0 }, Sampling::Area, (3, 1), &mut out);
        assert_eq!(out, [10, 10, 10]);
    }

    #[test]
    fn variations_differ_and_repeat() {
        let data: Vec<u8> = (0..64 * 64).map(|i| ((i % 64) * 3 + i / 64) as u8).collect();
        let picture = GreyView::new(&data, 64, 64, 64).expect("a picture");
        let make = |seed| {
            let mut out = Vec::new();
            let part = Part::whole(picture);
            vary(picture, part, &Variation::USUAL, &mut Rng::with_seed(seed), (24, 24), &mut out);
            out
        };
        assert_eq!(make(1), make(1));
        assert_ne!(make(1), make(2));
        assert_eq!(make(3).len(), 24 * 24);
    }
}
