//! The v-disparity histogram as an image, with the road profile.

use crate::reporting::picture::{Colour, Picture};
use perception::road::histogram::{BINS_PER_PX, VDisparity};
use perception::stereo::DisparityView;

/// Distance of the marks of both axes: disparities in px, rows of the image.
const MARKS_PX: usize = 16;
const MARKS_ROWS: usize = 100;

/// What the picture shows, in lines that fit into the picture from 64 disparities on.
const TITLE: [&str; 2] = ["row by disparity in px", "red: road profile"];
const TITLE_LEFT_PX: i32 = 70;

/// Draws counts in grey (logarithmic scale) and the road profile in red. One column per bin of 1/4 px, one row
/// per image row; marks tell disparities and rows.
pub fn draw(histogram: &VDisparity, profile_px: &[f32]) -> Picture {
    let (width, height) = (histogram.bins(), histogram.height());
    let pixels = (0..height).flat_map(|y| histogram.row(y).iter().map(|&c| shade(c)));
    let mut picture = Picture::from_pixels(pixels, width, height);
    for (y, &road) in profile_px.iter().enumerate() {
        if road > 0.0 {
            let x = (road * BINS_PER_PX as f32) as usize;
            for x in x.saturating_sub(1)..=x + 1 {
                picture.tint(x, y, [255, 40, 40], 220);
            }
        }
    }
    let (ink, bottom) = ([240, 240, 240], height as i32);
    for (i, line) in TITLE.into_iter().enumerate() {
        picture.text(line, TITLE_LEFT_PX, 4 + 14 * i as i32, ink);
    }
    for px in (MARKS_PX..width / BINS_PER_PX).step_by(MARKS_PX) {
        let x = (px * BINS_PER_PX) as i32;
        picture.fill([x, bottom - 4, 1, 4], ink);
        picture.text(&px.to_string(), x - 7, bottom - 18, ink);
    }
    for row in (MARKS_ROWS..height).step_by(MARKS_ROWS) {
        picture.fill([0, row as i32, 4, 1], ink);
        picture.text(&row.to_string(), 6, row as i32 - 6, ink);
    }
    picture
}

/// Draws the v-disparity histogram of a map (1/256 px, 0 = unknown): counts only, one column per 1/4 px below
/// `disparities` px.
pub fn of_map(disparity: DisparityView<'_>, disparities: usize) -> Picture {
    let (width, step) = (disparities.max(1) * BINS_PER_PX, 256 / BINS_PER_PX);
    let mut counts = vec![0_u16; width * disparity.height()];
    for (y, counts) in counts.chunks_exact_mut(width).enumerate() {
        for &d in disparity.row(y).iter().filter(|&&d| d > 0) {
            if let Some(count) = counts.get_mut(usize::from(d) / step) {
                *count = count.saturating_add(1);
            }
        }
    }
    Picture::from_pixels(counts.into_iter().map(shade), width, disparity.height())
}

fn shade(count: u16) -> Colour {
    let v = (f32::from(count) + 1.0).log2() * 28.0;
    [v.min(255.0) as u8; 3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::depth::DepthView;
    use perception::road::histogram::Corridor;

    #[test]
    fn counts_are_bright_and_the_path_is_red() {
        let mut histogram = VDisparity::new(50, 40, 16);
        let map: Vec<u16> = (0..40 * 50).map(|i| (i / 50 * 64) as u16).collect();
        let map = DisparityView::new(&map, 50, 40).unwrap();
        histogram.fill(DepthView::new(map, &[255; 2000]).unwrap(), 1, Corridor::UNBOUNDED);
        let mut profile = vec![0.0; 40];
        profile[30] = 3.0;
        let picture = draw(&histogram, &profile);
        assert_eq!((picture.width(), picture.height()), (64, 40));
        assert!(picture.at(25, 25)[0] > 100);
        let [r, g, _] = picture.at(12, 30);
        assert!(r > 200 && g < 60);
    }

    #[test]
    fn the_title_fits_64_disparities() {
        let widest = TITLE.into_iter().map(str::len).max().unwrap_or(0) as i32 * 7;
        assert!(TITLE_LEFT_PX + widest <= 64 * BINS_PER_PX as i32, "{widest}");
    }

    #[test]
    fn a_map_is_counted_row_by_row() {
        let map = [0, 256, 300, 320, 64 * 256, u16::MAX, 1, 63];
        let picture = of_map(DisparityView::new(&map, 4, 2).unwrap(), 8);
        assert_eq!((picture.width(), picture.height()), (32, 2));
        assert_eq!((picture.at(4, 0), picture.at(5, 0)), (shade(2), shade(1)));
        assert_eq!((picture.at(0, 0), picture.at(0, 1)), (shade(0), shade(2)), "unknown ones are left out");
    }
}
