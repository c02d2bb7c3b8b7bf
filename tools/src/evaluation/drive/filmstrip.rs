//! Pictures of an event: before it, at it, after it, with what was reported and the strip that was driven.

use super::strip::{DrivenPath, Strip};
use crate::reporting::overlay::{EdgePoints, OverlayInput, draw};
use crate::reporting::picture::{Colour, Picture};
use crate::reporting::record::FrameRecord;
use perception::rig::Rig;

/// Time from an event to the pictures before and after it, in seconds.
const APART_S: f64 = 0.5;

/// Colour of the driven strip.
const DRIVEN: Colour = [255, 90, 230];

/// The road of a frame, as overlays need it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoadLines {
    /// Disparity of the road in each row, in px.
    pub profile_px: Vec<f32>,
    /// Points of the road's edges.
    pub edges: EdgePoints,
}

/// One picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Still {
    /// What it shows.
    pub caption: String,
    /// The picture as the `src` of an HTML page.
    pub source: String,
}

/// The frames before, at and after an event.
pub fn frames(path: &DrivenPath, frame: usize) -> [usize; 3] {
    let at_s = path.time_s(frame);
    let before = path.frame_at(at_s - APART_S).min(frame.saturating_sub(1));
    let after = path.frame_at(at_s + APART_S).max(frame + 1).min(path.frames().saturating_sub(1));
    [before, frame, after]
}

/// Draws a frame: its left image with what was reported, and the driven strip in pink.
pub fn still(
    left: &[u8],
    (width, height): (usize, usize),
    rig: Rig,
    road: &RoadLines,
    record: &FrameRecord,
    strip: Option<&Strip>,
) -> Picture {
    // The road's surface would hide what is small.
    let disparity = vec![0; width * height];
    let (profile_px, edges) = (&road.profile_px[..], road.edges);
    let mut picture =
        draw(OverlayInput { left, disparity: &disparity, profile_px, edges, width, height, rig }, record);
    for edge in strip.iter().flat_map(|strip| strip.line().in_image(&rig, profile_px)) {
        for pair in edge.windows(2) {
            let [from, to] = [pair[0], pair[1]].map(|(x, y)| (x.round() as i32, y.round() as i32));
            picture.line(from, to, DRIVEN, 2);
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::super::strip::tests::straight;
    use super::*;

    #[test]
    fn pictures_are_half_a_second_apart_and_within_the_recording() {
        let path = straight(60, 8.0);
        assert_eq!(frames(&path, 20), [15, 20, 25]);
        assert_eq!((frames(&path, 0), frames(&path, 59)), ([0, 0, 5], [54, 59, 59]));
        // A recording of two frames a second.
        assert_eq!(frames(&straight(1, 8.0), 0), [0, 0, 0]);
    }

    #[test]
    fn the_driven_strip_is_drawn_on_the_road() {
        let rig = Rig { focal_px: 100.0, baseline_m: 0.3, cx_px: 100.0, cy_px: 50.0 };
        // A flat road 1.2 m below the camera.
        let profile_px =
            (0..100).map(|y| if y > 50 { 0.25 * (y - 50) as f32 } else { 0.0 }).collect::<Vec<f32>>();
        let road = RoadLines { profile_px, edges: EdgePoints::default() };
        let strip = straight(60, 8.0).strip(0).unwrap();
        let left = vec![90; 200 * 100];
        let record = FrameRecord::default();
        let is_pink = |strip| {
            let picture = still(&left, (200, 100), rig, &road, &record, strip);
            (0..200).filter(|&x| picture.at(x, 80) == DRIVEN).count()
        };
        assert!(is_pink(Some(&strip)) >= 2 && is_pink(None) == 0);
    }
}
