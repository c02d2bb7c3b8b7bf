//! The left image with road, obstacles and alarm drawn over it.

use crate::reporting::picture::{Colour, Picture};
use crate::reporting::record::{FrameRecord, ObstacleLine};
use perception::rig::Rig;
use perception::road::edges::SEGMENTS;

const RED: Colour = [255, 40, 40];
const ORANGE: Colour = [255, 165, 40];
const GREEN: Colour = [60, 220, 90];
const WHITE: Colour = [240, 240, 240];
const YELLOW: Colour = [250, 230, 60];
const BLUE: Colour = [70, 170, 255];

/// Columns and rows of the road's left and right edges, where visible, from near to far.
pub type EdgePoints = [[Option<(i32, i32)>; 2]; SEGMENTS];

/// Input of an overlay: images of one size, row-major.
#[derive(Clone, Copy, Debug)]
pub struct OverlayInput<'a> {
    /// Left image.
    pub left: &'a [u8],
    /// Disparity in 1/256 px, 0 = unknown.
    pub disparity: &'a [u16],
    /// Disparity of the road in each row, in px; 0 above it.
    pub profile_px: &'a [f32],
    /// Points of the road's edges.
    pub edges: EdgePoints,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Rig of the images.
    pub rig: Rig,
}

/// Draws the road surface in green and obstacles as [`draw`] does, without text: for reduced views.
pub fn draw_plain(input: OverlayInput<'_>, record: &FrameRecord) -> Picture {
    draw_with(input, record, false)
}

/// Draws the road surface in green, its edges in yellow, the edges of the vehicle's path in blue, confirmed obstacles in red with class, distance and its
/// standard deviation, unconfirmed ones in orange, predicted ones dashed, and the alarm at the top.
pub fn draw(input: OverlayInput<'_>, record: &FrameRecord) -> Picture {
    draw_with(input, record, true)
}

fn draw_with(input: OverlayInput<'_>, record: &FrameRecord, with_text: bool) -> Picture {
    let OverlayInput { left, disparity, profile_px, edges, width, height, rig: _ } = input;
    let mut picture = Picture::from_pixels(left.iter().map(|&v| [v, v, v]), width, height);
    for (y, &road) in profile_px.iter().enumerate().take(height) {
        if road <= 0.0 {
            continue;
        }
        let tolerance = 0.5 + 0.03 * road;
        for x in 0..width {
            let d = f32::from(disparity[y * width + x]) / 256.0;
            if d > 0.0 && (d - road).abs() < tolerance {
                picture.tint(x, y, GREEN, 70);
            }
        }
    }
    for side in [0, 1] {
        for pair in edges.windows(2) {
            if let (Some(near), Some(far)) = (pair[0][side], pair[1][side]) {
                picture.line(near, far, YELLOW, 2);
            }
        }
    }
    for edge in record.path.in_image(&input.rig, input.profile_px) {
        for pair in edge.windows(2) {
            let [from, to] = [pair[0], pair[1]].map(|(x, y)| (x.round() as i32, y.round() as i32));
            picture.line(from, to, BLUE, 2);
        }
    }
    // Far ones first, so that near ones are drawn over them.
    let mut order: Vec<&ObstacleLine> = record.obstacles.iter().collect();
    order.sort_by(|a, b| b.distance_m.total_cmp(&a.distance_m));
    for obstacle in order {
        let colour = if obstacle.confirmed { RED } else { ORANGE };
        let bounds = [obstacle.x_px, obstacle.y_px, obstacle.width_px, obstacle.height_px];
        if obstacle.predicted {
            picture.dashed_frame(bounds, colour, 2);
        } else {
            picture.frame(bounds, colour, 2);
        }
        let mut label = format!("{:.1}±{:.1}m", obstacle.distance_m, obstacle.distance_sigma_m);
        if obstacle.class != "obstacle" {
            label = format!("{} {label}", obstacle.class);
        }
        // Only where there is enough space.
        if with_text && obstacle.width_px >= 24 {
            picture.text(&label, obstacle.x_px as i32, obstacle.y_px as i32 - 13, colour);
        }
    }
    let colour = match record.alarm.level.as_str() {
        "alarm" => RED,
        "clear" => WHITE,
        _ => ORANGE,
    };
    if ["warning", "alarm"].contains(&record.alarm.level.as_str()) {
        picture.frame([0, 0, width as u32, height as u32], colour, 4);
    }
    if with_text {
        picture.text(&format!("frame {}  {}", record.sequence, record.alarm.text()), 6, 5, colour);
        picture.text(&record.motion.text(), 6, 19, if record.motion.known { BLUE } else { WHITE });
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reporting::record::AlarmLine;

    #[test]
    fn boxes_road_and_alarm_are_where_they_belong() {
        let (width, height) = (200, 100);
        let disparity: Vec<u16> = (0..width * height).map(|i| if i / width > 60 { 512 } else { 0 }).collect();
        let profile: Vec<f32> = (0..height).map(|y| if y > 60 { 2.0 } else { 0.0 }).collect();
        let obstacle = |x: u32, confirmed| ObstacleLine {
            class: "vehicle".into(),
            confirmed,
            x_px: x,
            y_px: 40,
            width_px: 30,
            height_px: 30,
            distance_m: 12.0,
            ..ObstacleLine::default()
        };
        let record = FrameRecord {
            alarm: AlarmLine {
                level: "alarm".into(),
                rule: Some("distance".into()),
                track: Some(1),
                nearest_m: Some(6.1),
                ..AlarmLine::default()
            },
            // A box beyond the image border must not panic.
            obstacles: vec![
                obstacle(20, true),
                obstacle(100, false),
                ObstacleLine { predicted: true, ..obstacle(60, true) },
                obstacle(190, true),
            ],
            ..FrameRecord::default()
        };
        let left = vec![90; width * height];
        let mut edges = EdgePoints::default();
        edges[1][1] = Some((150, 95));
        edges[2][1] = Some((150, 70));
        edges[4][0] = Some((-3000, 90));
        edges[5][0] = Some((60, 90));
        let profile_px = &profile;
        let rig = Rig { focal_px: 100.0, baseline_m: 0.3, cx_px: 100.0, cy_px: 50.0 };
        let input =
            OverlayInput { left: &left, disparity: &disparity, profile_px, edges, width, height, rig };
        let picture = draw(input, &record);
        assert_eq!(picture.at(21, 50), RED);
        assert_eq!(picture.at(101, 50), ORANGE);
        let dashed: Vec<bool> = (40..70).map(|y| picture.at(61, y) == RED).collect();
        let steps = dashed.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(dashed.contains(&true) && steps >= 3, "a prediction is dashed: {dashed:?}");
        assert_eq!(picture.at(1, 50), RED, "the frame of the alarm");
        assert_eq!([picture.at(150, 80), picture.at(20, 90)], [YELLOW; 2], "the road's edges");
        let [r, g, _] = picture.at(80, 80);
        assert!(g > r, "the road is green");
        assert_eq!(picture.at(80, 50), [90, 90, 90]);
        let plain = draw_plain(input, &record);
        assert_eq!((plain.at(21, 50), plain.at(8, 12)), (RED, [90, 90, 90]));
        assert_ne!(picture.at(8, 12), [90, 90, 90], "text");
    }
}
