//! Error images in the colours of the KITTI 2015 devkit.

use crate::reporting::picture::{Colour, Picture};

/// Colours of errors up to 1/16, 1/8, 1/4, 1/2, 1, 2, 4, 8, 16 times the outlier threshold, and beyond, as in
/// the devkit.
const COLOURS: [Colour; 10] = [
    [49, 54, 149],
    [69, 117, 180],
    [116, 173, 209],
    [171, 217, 233],
    [224, 243, 248],
    [254, 224, 144],
    [253, 174, 97],
    [244, 109, 67],
    [215, 48, 39],
    [165, 0, 38],
];

/// Input of an error image: one value per pixel each, disparities in px.
#[derive(Clone, Copy, Debug)]
pub struct ErrorInput<'a> {
    /// Left image.
    pub left: &'a [u8],
    /// Ground truth; not positive where unknown.
    pub truth: &'a [f32],
    /// Mask of the non-occluded pixels; errors elsewhere are drawn at half brightness.
    pub visible: &'a [bool],
    /// The evaluated estimate, without holes.
    pub filled: &'a [f32],
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

/// Colour of an error: the smaller of error ÷ 3 px and error ÷ 5 % of the true disparity, on a logarithmic
/// scale. Blue tones are inliers; light yellow to red are outliers by the rule of KITTI 2015.
pub fn colour(error_px: f32, truth_px: f32) -> Colour {
    let share = (error_px / 3.0).min(error_px / (0.05 * truth_px));
    let mut limit = 1.0 / 16.0;
    for colour in &COLOURS[..COLOURS.len() - 1] {
        if share <= limit {
            return *colour;
        }
        limit *= 2.0;
    }
    COLOURS[COLOURS.len() - 1]
}

/// Draws errors over the darkened left image. Each pixel with ground truth is drawn 3 × 3 px large to make
/// sparse ground truth visible; a pixel's own error takes precedence where they overlap.
pub fn draw(input: ErrorInput<'_>) -> Picture {
    let ErrorInput { left, truth, visible, filled, width, height } = input;
    let mut colours: Vec<Colour> = left.iter().map(|v| [v / 3; 3]).collect();
    let ink = |i: usize| {
        let ink = colour((filled[i] - truth[i]).abs(), truth[i]);
        if visible.get(i).is_some_and(|&v| v) { ink } else { ink.map(|c| c / 2) }
    };
    for i in (0..width * height).filter(|&i| truth[i] > 0.0) {
        let (x, y) = (i % width, i / width);
        for row in y.saturating_sub(1)..(y + 2).min(height) {
            for column in x.saturating_sub(1)..(x + 2).min(width) {
                if truth[row * width + column] <= 0.0 || (row, column) == (y, x) {
                    colours[row * width + column] = ink(i);
                }
            }
        }
    }
    Picture::from_pixels(colours.into_iter(), width, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_of_kitti_2015_parts_blue_from_red() {
        assert_eq!(colour(0.0, 20.0), COLOURS[0]);
        assert_eq!(colour(2.9, 20.0), COLOURS[4]);
        assert_eq!(colour(3.1, 20.0), COLOURS[5]);
        // 5 % of 100 px are 5 px.
        assert_eq!(colour(4.9, 100.0), COLOURS[4]);
        assert_eq!(colour(5.1, 100.0), COLOURS[5]);
        assert_eq!(colour(200.0, 20.0), COLOURS[9]);
    }

    #[test]
    fn sparse_truth_is_dilated_and_the_rest_is_dark() {
        let (width, height) = (9, 7);
        let mut truth = vec![-1.0; 63];
        truth[0] = 20.0;
        truth[3 * 9 + 5] = 20.0;
        truth[3 * 9 + 6] = 20.0;
        let mut filled = vec![20.0; 63];
        filled[3 * 9 + 6] = 90.0;
        let mut visible = vec![true; 63];
        visible[0] = false;
        let picture = draw(ErrorInput {
            left: &[90; 63],
            truth: &truth,
            visible: &visible,
            filled: &filled,
            width,
            height,
        });
        assert_eq!(picture.at(0, 0), COLOURS[0].map(|c| c / 2));
        assert_eq!(picture.at(1, 1), picture.at(0, 0));
        assert_eq!((picture.at(5, 3), picture.at(6, 3)), (COLOURS[0], COLOURS[9]));
        assert_eq!((picture.at(4, 2), picture.at(7, 4)), (COLOURS[0], COLOURS[9]));
        assert_eq!(picture.at(8, 0), [30, 30, 30]);
    }
}
