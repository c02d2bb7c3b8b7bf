//! Images and maps: recorded images, disparity maps with a scale, PFM.

use super::harness::{fuzz, written};
use std::path::Path;

/// A small image in a format.
fn picture(format: image::ImageFormat, colour: bool) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let grey = image::GrayImage::from_fn(24, 16, |x, y| [(x * y % 251) as u8].into());
    let image = image::DynamicImage::from(grey);
    let image = if colour { image.to_rgb8().into() } else { image };
    image.write_to(&mut out, format).expect("a picture can be written");
    out.into_inner()
}

fn deep() -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let map: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_fn(24, 16, |x, y| [(x * y * 97) as u16].into());
    image::DynamicImage::from(map).write_to(&mut out, image::ImageFormat::Png).expect("a map can be written");
    out.into_inner()
}

fn pfm() -> Vec<u8> {
    let mut out = b"Pf\n6 4\n-1.0\n".to_vec();
    (0..24).for_each(|i| out.extend((i as f32 * 0.5).to_le_bytes()));
    out
}

fn read_map(input: &[u8], path: &Path) -> String {
    let path = written(path, if input.starts_with(b"P") { "pfm" } else { "png" }, input);
    match sources::truth::map_file::read(&path, 256.0) {
        Err(error) => error.to_string(),
        Ok(map) => {
            assert_eq!(map.px.len(), map.width * map.height);
            assert!(map.px.iter().all(|&d| d > 0.0 || d == -1.0));
            "ok".into()
        }
    }
}

#[test]
fn recorded_image() {
    use image::ImageFormat::{Jpeg, Png, Pnm};
    let mut seeds: Vec<Vec<u8>> =
        [(Png, false), (Png, true), (Jpeg, false), (Jpeg, true), (Pnm, false), (Pnm, true)]
            .map(|(format, colour)| picture(format, colour))
            .into();
    seeds.push(deep());
    seeds.push(b"P2\n# text\n4 2\n255\n0 1 2 3 4 5 6 7\n".to_vec());
    fuzz("pictures::recorded_image", seeds, 1 << 14, |input, path| {
        match sources::folder::read_grey(&written(path, "png", input)) {
            Err(error) => error.to_string(),
            Ok((pixels, width, height)) => {
                assert_eq!(pixels.len(), width * height);
                "ok".into()
            }
        }
    });
}

#[test]
fn disparity_map() {
    fuzz(
        "pictures::disparity_map",
        vec![pfm(), deep(), picture(image::ImageFormat::Png, false)],
        1 << 14,
        read_map,
    );
}
