//! The left image with road, obstacles and alarm drawn over it.

use crate::reporting::picture::{Colour, Picture};
use crate::reporting::record::{FrameRecord, ObstacleLine};
use crate::reporting::space::polygon_in_image;
use perception::rig::Rig;
use perception::road::edges::SEGMENTS;

const RED: Colour = [255, 40, 40];
const ORANGE: Colour = [255, 165, 40];
const GREEN: Colour = [60, 220, 90];
const WHITE: Colour = [240, 240, 240];
const YELLOW: Colour = [250, 230, 60];
const BLUE: Colour = [70, 170, 255];
const VIOLET: Colour = [190, 110, 255];

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

/// Draws as [`draw`] does, without text: for reduced views.
pub fn draw_plain(input: OverlayInput<'_>, record: &FrameRecord) -> Picture {
    draw_with(input, record, false)
}

/// Draws the free space in green, the road's edges in yellow, boundaries as violet fences, the edges of the vehicle's path in
/// blue, confirmed obstacles in red with class, distance and its standard deviation, unconfirmed ones in orange, predicted ones dashed, and the
/// alarm at the top.
pub fn draw(input: OverlayInput<'_>, record: &FrameRecord) -> Picture {
    draw_with(input, record, true)
}

fn draw_with(input: OverlayInput<'_>, record: &FrameRecord, with_text: bool) -> Picture {
    let OverlayInput { left, profile_px, edges, width, height, .. } = input;
    let mut picture = Picture::from_pixels(left.iter().map(|&v| [v, v, v]), width, height);
    for polygon in &record.free_space_m {
        tint_polygon(&mut picture, &polygon_in_image(&input.rig, profile_px, polygon), (width, height));
    }
    for side in [0, 1] {
        for pair in edges.windows(2) {
            if let (Some(near), Some(far)) = (pair[0][side], pair[1][side]) {
                picture.line(near, far, YELLOW, 2);
            }
        }
    }
    for boundary in &record.boundaries {
        let [foot, top] = boundary.in_image(&input.rig, profile_px);
        let pixel = |(x, y): (f64, f64)| (x.round() as i32, y.round() as i32);
        for line in [&foot, &top] {
            for pair in line.windows(2) {
                picture.line(pixel(pair[0]), pixel(pair[1]), VIOLET, 2);
            }
        }
        for (foot, top) in foot.iter().zip(&top) {
            picture.line(pixel(*foot), pixel(*top), VIOLET, 1);
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

/// Tints the inside of a polygon (column, row) by the rule of even and odd crossings.
fn tint_polygon(picture: &mut Picture, corners: &[(f64, f64)], (width, height): (usize, usize)) {
    let mut crossings = Vec::new();
    for y in 0..height {
        let row = y as f64 + 0.5;
        crossings.clear();
        for (i, &(x0, y0)) in corners.iter().enumerate() {
            let (x1, y1) = corners[(i + 1) % corners.len()];
            if (y0 <= row) != (y1 <= row) {
                crossings.push(x0 + (row - y0) / (y1 - y0) * (x1 - x0));
            }
        }
        crossings.sort_unstable_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let [from, to] = [pair[0], pair[1]].map(|x| x.round().clamp(0.0, width as f64) as usize);
            (from..to).for_each(|x| picture.tint(x, y, GREEN, 70));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reporting::record::AlarmLine;

    #[test]
    fn boxes_road_and_alarm_are_where_they_belong() {
        let (width, height) = (200, 100);
        let disparity: Vec<u16> = (0..width * height).map(|i| if i / width > 60 { 512 } else { 0 }).collect();
        // A camera 1 m above the road.
        let profile: Vec<f32> = (0..height).map(|y| (0.3 * (y as f32 - 50.0)).max(0.0)).collect();
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
            free_space_m: vec![vec![[-10.0, 9.0], [10.0, 9.0], [10.0, 3.0], [-10.0, 3.0]]],
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
