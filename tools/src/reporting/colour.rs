//! Disparity colour maps: blue is far, red is near, black is unknown.

use crate::reporting::picture::{Colour, Picture};

/// A rainbow colour map with even brightness steps, from dark blue (0) to dark red (1).
pub fn rainbow(share: f32) -> Colour {
    const STOPS: [[f32; 3]; 9] = [
        [48.0, 18.0, 59.0],
        [70.0, 107.0, 227.0],
        [40.0, 187.0, 236.0],
        [49.0, 242.0, 153.0],
        [162.0, 252.0, 60.0],
        [237.0, 208.0, 58.0],
        [251.0, 128.0, 34.0],
        [210.0, 49.0, 5.0],
        [122.0, 4.0, 3.0],
    ];
    let share = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
    let at = share * (STOPS.len() - 1) as f32;
    let i = (at as usize).min(STOPS.len() - 2);
    let part = at - i as f32;
    std::array::from_fn(|c| (STOPS[i][c] * (1.0 - part) + STOPS[i + 1][c] * part).round() as u8)
}

/// A disparity map (1/256 px, 0 = unknown) in colour. `max_px` is red; the square-root scale spreads far
/// distances.
pub fn disparity(disparity: &[u16], width: usize, height: usize, max_px: f32) -> Picture {
    let colours = disparity.iter().map(|&d| match d {
        0 => [0, 0, 0],
        d => rainbow((f32::from(d) / 256.0 / max_px.max(1.0)).sqrt()),
    });
    Picture::from_pixels(colours, width, height)
}

/// Height of [`scale`], in px.
pub const SCALE_HEIGHT: usize = 32;
/// Disparities that a scale names, in px.
const NAMED_PX: [u16; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Least distance between the left ends of two names, in columns.
const NAME_COLUMNS: f32 = 48.0;

/// The colours of [`disparity`] with their values, to append below a map of `width` columns.
pub fn scale(width: usize, max_px: f32) -> Picture {
    let max_px = max_px.max(1.0);
    let share = |x: usize| x as f32 / width.saturating_sub(1).max(1) as f32;
    let row = (0..width).map(|x| rainbow(share(x)));
    let mut picture = Picture::new(width, SCALE_HEIGHT, [0, 0, 0]);
    for (x, colour) in row.enumerate() {
        picture.fill([x as i32, 2, 1, 12], colour);
    }
    let last = width as f32 - NAME_COLUMNS;
    let mut free = 0.0;
    let named = NAMED_PX.into_iter().filter(|px| f32::from(*px) < max_px);
    for px in named.map(f32::from).chain([max_px]) {
        let x = (px / max_px).sqrt() * (width as f32 - 1.0);
        // The largest ends with the picture, and none overlaps it.
        let left = x.min(last);
        let fits = px == max_px || left + NAME_COLUMNS <= last;
        if left >= free && fits {
            picture.fill([x as i32, 2, 1, 14], [255, 255, 255]);
            picture.text(&format!("{px:.0} px"), left as i32, 17, [240, 240, 240]);
            free = left + NAME_COLUMNS;
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_has_the_colours_of_the_map_at_their_values() {
        let (width, max_px) = (400, 64.0);
        let scale = scale(width, max_px);
        assert_eq!((scale.width(), scale.height()), (width, SCALE_HEIGHT));
        // A quarter of the largest disparity is in the middle, with a mark.
        let middle = disparity(&[16 * 256], 1, 1, max_px).at(0, 0);
        assert_eq!((scale.at(198, 8), scale.at(199, 8)), (rainbow(198.0 / 399.0), [255; 3]));
        // The largest one is named at the end, also where it is no power of two.
        for max_px in [64.0, 100.0] {
            assert_eq!(super::scale(width, max_px).at(399, 8), [255; 3]);
        }
        let far = |a: [u8; 3], b: [u8; 3]| (0..3).any(|c| a[c].abs_diff(b[c]) > 3);
        assert!(!far(scale.at(200, 8), middle) && far(scale.at(20, 8), middle));
        // Too narrow for values.
        assert_eq!(super::scale(3, max_px).width(), 3);
    }

    #[test]
    fn near_is_red_far_is_blue_unknown_is_black() {
        let picture = disparity(&[0, 256, 64 * 256], 3, 1, 64.0);
        assert_eq!(picture.at(0, 0), [0, 0, 0]);
        let [r, _, b] = picture.at(1, 0);
        assert!(b > r);
        let [r, _, b] = picture.at(2, 0);
        assert!(r > b);
        assert_eq!(rainbow(-3.0), rainbow(0.0));
        assert_eq!(rainbow(f32::NAN), rainbow(0.0));
    }
}
