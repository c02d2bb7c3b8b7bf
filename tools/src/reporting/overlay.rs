//! The left image with road, obstacles and alarm drawn over it.

use crate::reporting::labels::{self, Area, Setting, Wanted};
use crate::reporting::palette::{
    BOUNDARY, CAUSE, FREE, LEGEND, PATH, PLAIN, ROAD_EDGE, UNCONFIRMED, is_cause, of_obstacle,
};
use crate::reporting::picture::{Colour, Picture, TEXT_PX};
use crate::reporting::record::{FrameRecord, ObstacleLine};
use crate::reporting::space::polygon_in_image;
use perception::rig::Rig;
use perception::road::edges::SEGMENTS;

/// Narrowest unconfirmed box that has a label, in px.
const MIN_LABELLED_PX: u32 = 24;

/// Largest distance of an unconfirmed box that has a label, in metres: far away they are many, and most are nothing.
const MAX_UNCONFIRMED_M: f64 = 20.0;

/// Number of nearest obstacles with their whole label; farther ones have the distance alone.
const MAX_WHOLE_LABELS: usize = 6;

/// Left end of the legend.
const LEGEND_LEFT_PX: i32 = 6;
/// Rows of the lowest picture with a legend, in px.
const MIN_LEGEND_ROWS: i32 = 136;

/// First row of the text at the top, and distance of its lines, in px.
const HEADER_PX: (i32, i32) = (5, 14);

/// Width of the frame around the picture at a warning or an alarm, in px. No text lies on it.
const ALARM_FRAME_PX: u16 = 4;

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

/// Draws the free space, the road's edges, boundaries as fences, the edges of the vehicle's path, and obstacles with class,
/// distance and its standard deviation, predicted ones dashed; the alarm at the top, the legend of the colours
/// ([`crate::reporting::palette`]) at the bottom.
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
                picture.line(near, far, ROAD_EDGE, 2);
            }
        }
    }
    for boundary in &record.boundaries {
        let [foot, top] = boundary.in_image(&input.rig, profile_px);
        let pixel = |(x, y): (f64, f64)| (x.round() as i32, y.round() as i32);
        for line in [&foot, &top] {
            for pair in line.windows(2) {
                picture.line(pixel(pair[0]), pixel(pair[1]), BOUNDARY, 2);
            }
        }
        for (foot, top) in foot.iter().zip(&top) {
            picture.line(pixel(*foot), pixel(*top), BOUNDARY, 1);
        }
    }
    for edge in record.path.in_image(&input.rig, input.profile_px) {
        for pair in edge.windows(2) {
            let [from, to] = [pair[0], pair[1]].map(|(x, y)| (x.round() as i32, y.round() as i32));
            picture.line(from, to, PATH, 2);
        }
    }
    // Far ones first, so that near ones are drawn over them.
    let mut order: Vec<&ObstacleLine> = record.obstacles.iter().filter(|o| o.is_shown()).collect();
    order.sort_by(|a, b| b.distance_m.total_cmp(&a.distance_m));
    for obstacle in order {
        let colour = of_obstacle(record, obstacle);
        let bounds = [obstacle.x_px, obstacle.y_px, obstacle.width_px, obstacle.height_px];
        let thickness = if is_cause(record, obstacle) { 3 } else { 2 };
        if obstacle.predicted {
            picture.dashed_frame(bounds, colour, thickness);
        } else {
            picture.frame(bounds, colour, thickness);
        }
    }
    let colour = match record.alarm.level.as_str() {
        "alarm" => CAUSE,
        "clear" => PLAIN,
        _ => UNCONFIRMED,
    };
    let mut margin = 0;
    if ["warning", "alarm"].contains(&record.alarm.level.as_str()) {
        picture.frame([0, 0, width as u32, height as u32], colour, ALARM_FRAME_PX.into());
        margin = ALARM_FRAME_PX.into();
    }
    if with_text {
        let header = header_lines(record, width);
        draw_labels(&mut picture, record, header.len(), margin);
        draw_legend(&mut picture, margin);
        let motion = (record.motion.text(), if record.motion.known { PATH } else { PLAIN });
        let lines = header.into_iter().map(|line| (line, colour)).chain([motion]);
        for (y, (line, colour)) in (HEADER_PX.0..).step_by(HEADER_PX.1 as usize).zip(lines) {
            picture.text(&line, 6, y, colour);
        }
    }
    picture
}

/// Frame and alarm, in lines that fit into the picture.
fn header_lines(record: &FrameRecord, width: usize) -> Vec<String> {
    let text = format!("frame {}  {}", record.sequence, record.alarm.text());
    let most = (width / TEXT_PX.0 as usize).saturating_sub(2).max(1);
    let mut lines: Vec<String> = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() || line.chars().count() + 1 + word.chars().count() <= most => {
                if !line.is_empty() {
                    line.push(' ');
                }
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The labels of the obstacles, the cause of an alarm first, then the nearest; none within `margin` px of the edge.
fn draw_labels(picture: &mut Picture, record: &FrameRecord, header_lines: usize, margin: i32) {
    let is_labelled = |o: &&ObstacleLine| {
        o.confirmed || (o.is_shown() && o.width_px >= MIN_LABELLED_PX && o.distance_m <= MAX_UNCONFIRMED_M)
    };
    let mut order: Vec<&ObstacleLine> = record.obstacles.iter().filter(is_labelled).collect();
    order.sort_by(|a, b| {
        let rank = |o: &ObstacleLine| (!is_cause(record, o), !o.confirmed);
        rank(a).cmp(&rank(b)).then(a.distance_m.total_cmp(&b.distance_m))
    });
    let wanted = |(rank, o): (usize, &&ObstacleLine)| {
        let [whole, short] = texts(o);
        let first = if rank < MAX_WHOLE_LABELS { whole } else { short.clone() };
        Wanted { area: area(o), texts: [first, short] }
    };
    let wanted: Vec<Wanted> = order.iter().enumerate().map(wanted).collect();
    let (character, line) = TEXT_PX;
    let side = |px: usize| i32::try_from(px).unwrap_or(i32::MAX);
    let size = (side(picture.width()), side(picture.height()));
    let legend = [0, size.1 - line - margin, size.0, size.1];
    // With the line of the own motion.
    let header = HEADER_PX.0 + HEADER_PX.1 * (header_lines as i32 + 1);
    let taken = [[0, 0, size.0, header.min(size.1)], legend];
    for label in labels::place(&wanted, Setting { character, line, size, margin }, &taken) {
        let colour = of_obstacle(record, order[label.index]);
        if let Some([from, to]) = label.leader {
            picture.line(from, to, colour, 1);
        }
        picture.text(&label.text, label.area[0] + 1, label.area[1], colour);
    }
}

fn area(o: &ObstacleLine) -> Area {
    let edge = |px: u32| i32::try_from(px).unwrap_or(i32::MAX);
    let (right, bottom) = (o.x_px.saturating_add(o.width_px), o.y_px.saturating_add(o.height_px));
    [edge(o.x_px), edge(o.y_px), edge(right), edge(bottom)]
}

/// The label of an obstacle, and a short one.
fn texts(o: &ObstacleLine) -> [String; 2] {
    let long = format!("{:.1}+-{:.1}m", o.distance_m, o.distance_sigma_m);
    let short = format!("{:.0}m", o.distance_m);
    if o.class == "obstacle" { [long, short] } else { [format!("{} {long}", o.class), short] }
}

/// The colours and their meaning in the last row above the `margin`, where the picture is wide enough.
fn draw_legend(picture: &mut Picture, margin: i32) {
    let line = TEXT_PX.1;
    let (width, height) = (picture.width() as i32, picture.height() as i32);
    if legend_width_px() > width - margin || height < MIN_LEGEND_ROWS {
        return;
    }
    let mut x = LEGEND_LEFT_PX;
    for (text, colour) in legend() {
        picture.text(text, x, height - line - margin, colour);
        x += legend_word_px(text);
    }
}

fn legend() -> impl Iterator<Item = (&'static str, Colour)> {
    LEGEND.into_iter().chain([("dashed: predicted", PLAIN)])
}

/// Width of a word of the legend with the space behind it.
fn legend_word_px(text: &str) -> i32 {
    (text.len() as i32 + 1) * TEXT_PX.0
}

fn legend_width_px() -> i32 {
    LEGEND_LEFT_PX + legend().map(|(text, _)| legend_word_px(text)).sum::<i32>()
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
            (from..to).for_each(|x| picture.tint(x, y, FREE, 70));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reporting::palette::CONFIRMED;
    use crate::reporting::record::AlarmLine;

    #[test]
    fn pictures_of_640_px_have_a_legend_also_within_the_frame_of_an_alarm() {
        assert!(legend_width_px() <= 640 - i32::from(ALARM_FRAME_PX), "{}", legend_width_px());
    }

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
        // Below the text.
        assert_eq!(picture.at(21, 66), CONFIRMED);
        assert_eq!(picture.at(101, 66), UNCONFIRMED);
        let dashed: Vec<bool> = (40..70).map(|y| picture.at(61, y) == CONFIRMED).collect();
        let steps = dashed.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(dashed.contains(&true) && steps >= 3, "a prediction is dashed: {dashed:?}");
        assert_eq!(picture.at(1, 50), CAUSE, "the frame of the alarm");
        assert_eq!([picture.at(150, 80), picture.at(20, 90)], [ROAD_EDGE; 2], "the road's edges");
        let [r, g, _] = picture.at(80, 80);
        assert!(g > r, "the road is green");
        let lines = header_lines(&record, width);
        assert!(lines.len() > 1 && lines.iter().all(|line| line.len() * 7 < width), "{lines:?}");
        let plain = draw_plain(input, &record);
        assert_eq!((plain.at(21, 50), plain.at(8, 12)), (CONFIRMED, [90, 90, 90]));
        assert_eq!(plain.at(80, 50), [90, 90, 90], "beyond the free space");
        assert_ne!(picture.at(8, 12), [90, 90, 90], "text");
    }

    #[test]
    fn the_frame_of_the_alarm_covers_no_label() {
        let (width, height) = (640, 240);
        let left = vec![90; width * height];
        let (disparity, profile) = (vec![0; width * height], vec![0.0; height]);
        let rig = Rig { focal_px: 100.0, baseline_m: 0.3, cx_px: 320.0, cy_px: 120.0 };
        let input = OverlayInput {
            left: &left,
            disparity: &disparity,
            profile_px: &profile,
            edges: EdgePoints::default(),
            width,
            height,
            rig,
        };
        // Boxes that end at the left and the right edge.
        let obstacle = |x: u32| ObstacleLine {
            confirmed: true,
            x_px: x,
            y_px: 100,
            width_px: 10,
            height_px: 60,
            distance_m: 12.0,
            ..ObstacleLine::default()
        };
        let alarm = AlarmLine { level: "alarm".into(), ..AlarmLine::default() };
        let obstacles = vec![obstacle(0), obstacle(630)];
        let picture = draw(input, &FrameRecord { alarm, obstacles, ..FrameRecord::default() });
        let frame = ALARM_FRAME_PX as usize;
        for depth in 0..frame {
            let is_whole = (0..height)
                .all(|y| [depth, width - 1 - depth].map(|x| picture.at(x, y)) == [CAUSE; 2])
                && (0..width).all(|x| [depth, height - 1 - depth].map(|y| picture.at(x, y)) == [CAUSE; 2]);
            assert!(is_whole, "no text lies on the frame, {depth} px from the edge");
        }
        // The labels above the boxes, 79 px wide with their dark background, begin and end at the frame.
        assert_eq!([picture.at(frame + 78, 88), picture.at(width - frame - 79, 88)], [[0, 0, 0]; 2]);
    }
}
