//! How much of a thing should be seen in a frame: what lies inside both pictures, within range, and is not hidden.

use super::extent::contained_share;
use super::parameters::{FADING_SHARE, TrackerParameters};

/// Where the box of a thing is expected, in px, and its distance in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// Left, top, right, bottom, also outside of the picture.
    pub edges: [f64; 4],
    /// Distance, in metres.
    pub distance_m: f64,
    /// Disparity, in px.
    pub disparity_px: f64,
}

/// Share of a thing that should be seen, 0 to 1; `nearer` are the boxes of what stands in front of it.
pub(super) fn visible_share(
    thing: &Expected,
    nearer: impl Iterator<Item = [f64; 4]>,
    parameters: &TrackerParameters,
    size: (u32, u32),
) -> f64 {
    if thing.disparity_px > parameters.max_disparity_px {
        return 0.0;
    }
    let share = thing.distance_m / parameters.max_distance_m;
    let in_range = ((1.0 - share) / (1.0 - FADING_SHARE)).clamp(0.0, 1.0);
    let inside = inside_share(&thing.edges, thing.disparity_px, size);
    let hidden: f64 = nearer.map(|edges| contained_share(&thing.edges, &edges)).sum();
    in_range * inside * (1.0 - hidden).max(0.0)
}

/// Share of a box that lies within the area that both cameras see, 0 to 1.
pub(super) fn inside_share(edges: &[f64; 4], disparity_px: f64, (width, height): (u32, u32)) -> f64 {
    // On the left, the right camera misses as many columns as the disparity.
    contained_share(edges, &[disparity_px, 0.0, f64::from(width), f64::from(height)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(edges: [f64; 4], distance_m: f64, nearer: &[[f64; 4]]) -> f64 {
        let thing = Expected { edges, distance_m, disparity_px: 100.0 / distance_m };
        visible_share(&thing, nearer.iter().copied(), &TrackerParameters::default(), (640, 480))
    }

    #[test]
    fn what_is_outside_hidden_or_far_is_not_expected() {
        let whole = [300.0, 200.0, 340.0, 240.0];
        assert_eq!(share(whole, 20.0, &[]), 1.0);
        assert_eq!(share([620.0, 200.0, 660.0, 240.0], 20.0, &[]), 0.5, "half out of the picture");
        assert_eq!(
            share([-15.0, 200.0, 25.0, 240.0], 20.0, &[]),
            0.5,
            "the right camera does not see the left border"
        );
        assert_eq!(share(whole, 20.0, &[[320.0, 100.0, 400.0, 300.0]]), 0.5, "half hidden");
        assert_eq!(share(whole, 20.0, &[[280.0, 100.0, 400.0, 300.0]]), 0.0, "hidden");
        assert!((share(whole, 52.5, &[]) - 0.5).abs() < 1e-9);
        assert_eq!(share(whole, 61.0, &[]), 0.0, "out of range");
        assert_eq!(share(whole, 0.7, &[]), 0.0, "too near for the matcher");
    }
}
