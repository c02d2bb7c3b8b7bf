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

#[cfg(test)]
mod tests {
    use super::*;

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
