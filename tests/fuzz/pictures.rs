//! Images and maps: recorded images, disparity maps with a scale, PFM.

use super::containers;
use super::harness::{Format, fuzz_format, written};
use fastrand::Rng;
use image::ImageFormat::{Bmp, Jpeg, Png, Pnm, Tiff, WebP};
use image::{DynamicImage, ImageBuffer, Luma};

/// A small image of a random size, kind and format.
fn some_picture(random: &mut Rng) -> Vec<u8> {
    let (width, height) = (random.u32(1..40), random.u32(1..30));
    let step = random.u32(1..9);
    let grey = image::GrayImage::from_fn(width, height, |x, y| [(x * y * step % 251) as u8].into());
    let grey = DynamicImage::from(grey);
    let format = [Png, Png, Jpeg, Pnm, Tiff, Bmp, WebP][random.usize(0..7)];
    let image: DynamicImage = match random.u8(0..6) {
        0 => grey.to_rgb8().into(),
        1 if format == Png => grey.to_rgba8().into(),
        2 if format == Png => grey.to_luma_alpha8().into(),
        3 if format == Png || format == Tiff => grey.to_luma16().into(),
        4 if format == Png => grey.to_rgb16().into(),
        _ => grey,
    };
    let mut out = std::io::Cursor::new(Vec::new());
    image.write_to(&mut out, format).expect("a picture can be written");
    out.into_inner()
}

/// A PNM in text.
fn some_text(random: &mut Rng) -> Vec<u8> {
    let (width, height) = (random.usize(1..9), random.usize(1..9));
    let values: String = (0..width * height).map(|_| format!("{} ", random.u8(..))).collect();
    format!("P2\n# text\n{width} {height}\n255\n{values}\n").into_bytes()
}

/// A 16-bit map.
fn some_map(random: &mut Rng) -> Vec<u8> {
    let (width, height, step) = (random.u32(1..40), random.u32(1..30), random.u32(1..99));
    let map: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(width, height, |x, y| [(x * y * step) as u16].into());
    let mut out = std::io::Cursor::new(Vec::new());
    DynamicImage::from(map).write_to(&mut out, Png).expect("a map can be written");
    out.into_inner()
}

fn some_pfm(random: &mut Rng) -> Vec<u8> {
    let (width, height) = (random.usize(1..12), random.usize(1..9));
    let is_little = random.bool();
    let mut out = format!("Pf\n{width} {height}\n{}\n", if is_little { "-1.0" } else { "1.0" }).into_bytes();
    for i in 0..width * height {
        let value = if random.u8(0..9) == 0 { f32::INFINITY } else { i as f32 * 0.5 };
        out.extend(if is_little { value.to_le_bytes() } else { value.to_be_bytes() });
    }
    out
}

#[test]
fn recorded_image() {
    let mut generate =
        |random: &mut Rng| if random.u8(0..8) == 0 { some_text(random) } else { some_picture(random) };
    let name = "pictures::recorded_image";
    let format = Format { name, longest: 1 << 14, generate: &mut generate, change: containers::picture };
    fuzz_format(format, |input, path| {
        let read = sources::folder::read_grey(&written(path, "png", input));
        let (pixels, width, height) = read.map_err(|e| e.to_string())?;
        assert_eq!(pixels.len(), width * height);
        Ok(format!("ok {}", (width * height).ilog2() / 4))
    });
}

#[test]
fn disparity_map() {
    let mut generate = |random: &mut Rng| if random.bool() { some_pfm(random) } else { some_map(random) };
    let name = "pictures::disparity_map";
    let format = Format { name, longest: 1 << 14, generate: &mut generate, change: containers::picture };
    fuzz_format(format, |input, path| {
        let path = written(path, if input.starts_with(b"P") { "pfm" } else { "png" }, input);
        let map = sources::truth::map_file::read(&path, 256.0).map_err(|e| e.to_string())?;
        assert_eq!(map.px.len(), map.width * map.height);
        assert!(map.px.iter().all(|&d| d > 0.0 || d == -1.0));
        Ok(format!("ok {}", map.px.len().ilog2() / 4))
    });
}
