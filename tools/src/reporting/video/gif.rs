//! Animated GIF: shown by every browser, viewer, chat and slide program, and written without another program.
//!
//! GIF has 256 colours and packs grey camera noise badly (about 0.4 bytes a pixel here), so it suits short, small
//! pictures: frames are scaled down to at most [`MAX_WIDTH`], at most [`MAX_RATE_HZ`] are shown, and the file ends after
//! [`MAX_PICTURES`]. All pictures share one palette, and pixels that keep their colour are transparent, which packs
//! better.

use super::frames::Frames;
use super::outcome::{Video, VideoError};
use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use image::RgbImage;
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Maximum width in pixels: wider frames are reduced by a whole factor.
const MAX_WIDTH: u32 = 800;

/// Maximum number of pictures a second.
const MAX_RATE_HZ: f64 = 15.0;

/// Maximum number of pictures: 40 s to a minute, about 70 MB of 640 × 480 pixels.
pub const MAX_PICTURES: u64 = 600;

/// Pictures come a little later or earlier than their rate.
const JITTER: f64 = 0.1;

/// Palette index of pixels that keep their colour.
const SAME: u8 = 0;

/// Number of greys: the camera's picture. More would mostly show its noise.
const GREYS: usize = 48;

/// Number of steps of each of red, green and blue: what is drawn over it.
const STEPS: usize = 5;

/// Number of greens: the road, whose grey is tinted.
const GREENS: usize = 48;

/// Bits of each colour component by which the nearest palette entry is looked up.
const BITS: u32 = 6;

/// The palette, and the nearest entry to every colour.
struct Palette {
    colours: Vec<[u8; 3]>,
    nearest: Vec<u8>,
}

impl Palette {
    fn new() -> Self {
        let level = |i: usize, count: usize| (i * 255 / (count - 1)) as u8;
        let mut colours = vec![[0, 0, 0]];
        colours.extend((0..GREYS).map(|i| [level(i, GREYS); 3]));
        // As overlays tint the road: the grey with 70 / 256 of green.
        colours.extend((0..GREENS).map(|i| {
            let tinted = |green: u16| ((u16::from(level(i, GREENS)) * 186 + green * 70) >> 8) as u8;
            [tinted(60), tinted(220), tinted(90)]
        }));
        for i in 0..STEPS.pow(3) {
            let rgb = [i / (STEPS * STEPS), i / STEPS % STEPS, i % STEPS];
            colours.push(rgb.map(|step| level(step, STEPS)));
        }
        let middle = |bits: u32| i32::try_from((bits << (8 - BITS)) + (1 << (7 - BITS))).unwrap_or(0);
        let mask = (1 << BITS) - 1;
        let nearest = (0..1_u32 << (3 * BITS)).map(|key| {
            let wanted = [key >> (2 * BITS), (key >> BITS) & mask, key & mask].map(middle);
            let distance = |colour: &[u8; 3]| -> i32 {
                colour.iter().zip(wanted).map(|(&c, w)| (i32::from(c) - w).pow(2)).sum()
            };
            // The first entry stands for pixels that keep their colour.
            let found = colours.iter().enumerate().skip(1).min_by_key(|(_, colour)| distance(colour));
            found.map_or(1, |(i, _)| i as u8)
        });
        let nearest = nearest.collect();
        Self { colours, nearest }
    }

    fn index(&self, colour: [u8; 3]) -> u8 {
        let [r, g, b] = colour.map(|c| usize::from(c >> (8 - BITS)));
        self.nearest[(r << (2 * BITS)) | (g << BITS) | b]
    }
}

/// Means of squares of `factor` × `factor` pixels.
fn reduced(picture: &RgbImage, factor: u32) -> RgbImage {
    if factor == 1 {
        return picture.clone();
    }
    let (width, height) = (picture.width() / factor, picture.height() / factor);
    RgbImage::from_fn(width, height, |x, y| {
        let mut sums = [0_u32; 3];
        for dy in 0..factor {
            for dx in 0..factor {
                let pixel = picture.get_pixel(x * factor + dx, y * factor + dy);
                sums.iter_mut().zip(pixel.0).for_each(|(sum, c)| *sum += u32::from(c));
            }
        }
        image::Rgb(sums.map(|sum| (sum / (factor * factor)) as u8))
    })
}

/// Writes pictures with one palette, each as what differs from the one before.
struct Writer<W: Write> {
    encoder: Encoder<W>,
    palette: Palette,
    size: (u16, u16),
    shown: Vec<u8>,
    /// Playing time so far, in seconds, and as the hundredths that were written.
    time_s: f64,
    time_cs: u64,
}

impl<W: Write> Writer<W> {
    fn new(output: W, size: (u16, u16)) -> Result<Self, EncodingError> {
        let palette = Palette::new();
        let mut encoder = Encoder::new(output, size.0, size.1, palette.colours.as_flattened())?;
        encoder.set_repeat(Repeat::Infinite)?;
        Ok(Self { encoder, palette, size, shown: Vec::new(), time_s: 0.0, time_cs: 0 })
    }

    fn picture(&mut self, picture: &RgbImage, shown_s: f64) -> Result<(), EncodingError> {
        let indices: Vec<u8> = picture.pixels().map(|pixel| self.palette.index(pixel.0)).collect();
        let mut changes = indices.clone();
        for (change, before) in changes.iter_mut().zip(&self.shown) {
            if change == before {
                *change = SAME;
            }
        }
        self.shown = indices;
        self.time_s += shown_s;
        let delay = ((self.time_s * 100.0).round() as u64).saturating_sub(self.time_cs);
        self.time_cs += delay;
        self.encoder.write_frame(&Frame {
            delay: u16::try_from(delay).unwrap_or(u16::MAX),
            dispose: DisposalMethod::Keep,
            transparent: Some(SAME),
            width: self.size.0,
            height: self.size.1,
            buffer: Cow::Borrowed(&changes),
            ..Frame::default()
        })
    }
}

/// Frames that are joined to pictures: the first frame of each, with the time until the next picture.
fn pictures(frames: &Frames) -> Vec<(usize, f64)> {
    let least_s = (1.0 - JITTER) / MAX_RATE_HZ;
    let mut pictures: Vec<(usize, f64)> = Vec::new();
    for (i, frame) in frames.frames.iter().enumerate() {
        match pictures.last_mut() {
            Some((_, shown_s)) if *shown_s < least_s => *shown_s += frame.shown_s,
            _ => pictures.push((i, frame.shown_s)),
        }
    }
    pictures
}

/// Writes the video to `path`.
pub(super) fn write(frames: &Frames, path: &Path, done: &mut dyn FnMut(u64)) -> Result<Video, VideoError> {
    let io = |source| VideoError::Io { path: path.to_owned(), source };
    let fail = |error: EncodingError| match error {
        EncodingError::Io(source) => io(source),
        error => io(std::io::Error::other(error.to_string())),
    };
    let factor = frames.width.div_ceil(MAX_WIDTH).max(1);
    let side = |pixels: u32| u16::try_from(pixels / factor).unwrap_or(u16::MAX);
    let mut file = BufWriter::new(File::create(path).map_err(io)?);
    let mut writer = Writer::new(&mut file, (side(frames.width), side(frames.height))).map_err(fail)?;
    let all = pictures(frames);
    let count = all.len().min(MAX_PICTURES as usize);
    for (i, shown_s) in &all[..count] {
        let picture = frames.picture(&frames.frames[*i])?;
        writer.picture(&reduced(&picture, factor), *shown_s).map_err(fail)?;
        done(*i as u64 + 1);
    }
    let seconds = writer.time_cs as f64 / 100.0;
    drop(writer);
    file.flush().map_err(io)?;
    let left_out = all.get(count).map_or(0, |(first, _)| frames.frames.len() - first);
    Ok(Video { pictures: count as u64, seconds, left_out: left_out as u64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greys_and_the_colours_of_overlays_keep_their_hue() {
        let palette = Palette::new();
        assert!(palette.colours.len() <= 256);
        let shown = |colour: [u8; 3]| palette.colours[usize::from(palette.index(colour))];
        for grey in 0..=255 {
            let [r, g, b] = shown([grey; 3]);
            assert!(r == g && g == b && r.abs_diff(grey) <= 6, "{grey}: {:?}", [r, g, b]);
        }
        for colour in [[255, 40, 40], [255, 165, 40], [60, 220, 90], [250, 230, 60], [70, 170, 255]] {
            let near = shown(colour);
            assert!(near.iter().zip(colour).all(|(a, b)| a.abs_diff(b) <= 40), "{colour:?}: {near:?}");
        }
    }

    #[test]
    fn pixels_that_stay_are_transparent_and_times_do_not_drift() {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes, (2, 1)).unwrap();
        let picture = |right: u8| RgbImage::from_raw(2, 1, vec![200, 200, 200, right, right, right]).unwrap();
        for right in [0, 0, 255] {
            writer.picture(&picture(right), 1.0 / 30.0).unwrap();
        }
        drop(writer);
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes.as_slice()).unwrap();
        let mut frames = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            frames.push((frame.delay, frame.buffer.to_vec()));
        }
        assert_eq!(frames.iter().map(|(delay, _)| *delay).collect::<Vec<_>>(), [3, 4, 3]);
        assert!(frames[0].1.iter().all(|&i| i != SAME));
        assert_eq!(frames[1].1, [SAME, SAME]);
        assert!(frames[2].1[0] == SAME && frames[2].1[1] != SAME);
    }

    #[test]
    fn pictures_are_reduced_by_means() {
        let picture = RgbImage::from_fn(4, 2, |x, _| image::Rgb([x as u8 * 10, 0, 255]));
        assert_eq!(reduced(&picture, 2).into_raw(), [5, 0, 255, 25, 0, 255]);
    }
}
