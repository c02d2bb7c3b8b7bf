//! The v-disparity histogram as a picture, with the road's path.

use crate::picture::Picture;
use perception::road::histogram::{BINS_PER_PX, VDisparity};

/// Draws counts in grey (by their logarithm), the road's profile in red, with a legend. One column per bin of
/// 1/4 px, one row per image row.
pub fn draw(histogram: &VDisparity, profile_px: &[f32]) -> Picture {
    let mut picture = counts(histogram);
    for (y, &road) in profile_px.iter().enumerate() {
        if road > 0.0 {
            let x = (road * BINS_PER_PX as f32) as usize;
            for x in x.saturating_sub(1)..=x + 1 {
                picture.tint(x, y, [255, 40, 40], 220);
            }
        }
    }
    picture.text("disparity ->, red = road", 70, 4, [240, 240, 240]);
    picture
}

/// The counts alone.
pub fn counts(histogram: &VDisparity) -> Picture {
    let (width, height) = (histogram.bins(), histogram.height());
    let shade = |count: u16| {
        let v = (f32::from(count) + 1.0).log2() * 28.0;
        [v.min(255.0) as u8; 3]
    };
    let pixels = (0..height).flat_map(|y| histogram.row(y).iter().map(|&c| shade(c)));
    Picture::from_pixels(pixels, width, height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::stereo::DisparityView;

    #[test]
    fn counts_are_bright_and_the_path_is_red() {
        let mut histogram = VDisparity::new(40, 16);
        let map: Vec<u16> = (0..40 * 50).map(|i| (i / 50 * 64) as u16).collect();
        histogram.fill(DisparityView::new(&map, 50, 40).unwrap());
        let mut profile = vec![0.0; 40];
        profile[30] = 3.0;
        let picture = draw(&histogram, &profile);
        assert_eq!((picture.width(), picture.height()), (64, 40));
        assert!(picture.at(25, 25)[0] > 100);
        let [r, g, _] = picture.at(12, 30);
        assert!(r > 200 && g < 60);
    }
}
