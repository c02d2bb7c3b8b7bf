//! One complete frame as the page shows it. Pictures are encoded on the first request.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use messages::header::Header;
use messages::pipeline::PATH_LENGTH;
use messages::regions::{RegionRecord, Regions};
use perception::point_cloud::{self, PointCloudParameters};
use perception::range::Range;
use perception::rig::Rig;
use perception::stereo::DisparityView;
use serde::Serialize;
use std::sync::OnceLock;
use tools::reporting::picture::Picture;
use tools::reporting::record::{FrameRecord, tidy};
use tools::reporting::space::polygon_in_image;
use tools::reporting::{colour, v_disparity};

/// JPEG quality, 1 to 100.
const QUALITY: u8 = 75;

/// Approximate number of pixels sampled for the point cloud.
const POINTS: usize = 6000;

/// Rows between two points of the road profile.
const PROFILE_STEP: usize = 4;

/// Disparity maps of at least this width are shown at half size.
const HALVED_WIDTH: usize = 400;

/// Parts of a frame that a client may request in addition to its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The left image: JPEG.
    Left,
    /// The disparity in colour: JPEG.
    Disparity,
    /// The v-disparity histogram: JPEG, one column for each 1/4 px.
    VDisparity,
    /// Points, 8 bytes each: x, y, z in centimetres (i16, little-endian), grey (u8), 0.
    Points,
}

impl Part {
    /// All parts.
    pub const ALL: [Part; 4] = [Part::Left, Part::Disparity, Part::VDisparity, Part::Points];

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Part::Left => "left",
            Part::Disparity => "disparity",
            Part::VDisparity => "v_disparity",
            Part::Points => "points",
        }
    }
}

/// A sighting, before tracking.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct RegionLine {
    x_px: u32,
    y_px: u32,
    width_px: u32,
    height_px: u32,
    distance_m: f64,
    lateral_m: f64,
    width_m: f64,
    evidence: f64,
}

impl RegionLine {
    fn new(region: &RegionRecord) -> Self {
        let [x_px, y_px, width_px, height_px] = region.bounds;
        let (distance_m, lateral_m, width_m) =
            (tidy(region.distance_m), tidy(region.lateral_m), tidy(region.width_m));
        let evidence = tidy(region.evidence);
        Self { x_px, y_px, width_px, height_px, distance_m, lateral_m, width_m, evidence }
    }
}

/// The values of a frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameLine {
    /// As in `obstacles.jsonl`.
    #[serde(flatten)]
    record: FrameRecord,
    width: usize,
    height: usize,
    /// Number of disparities searched: the right end of the v-disparity, and red in the disparity map.
    disparities: usize,
    focal_px: f64,
    baseline_m: f64,
    cx_px: f64,
    /// From capture to obstacles.
    latency_ms: f64,
    /// Work of each stage.
    stage_ms: [f64; PATH_LENGTH],
    /// Slope of the road: rows from the principal point to the horizon, divided by the focal length.
    road_tilt: Option<f64>,
    /// Road profile: (row, disparity in px), from the top down.
    profile: Vec<(usize, f32)>,
    regions: Vec<RegionLine>,
    /// Distance up to which the ground is known to be free, in metres, for each `free_columns_px` columns from the left;
    /// 0 if nothing is.
    free_m: Vec<f32>,
    free_columns_px: usize,
    /// Free space in the left image: polygons of column, row.
    free_px: Vec<Vec<(f64, f64)>>,
    /// Boundaries in the left image: foot and top, column and row of each point.
    boundaries_px: Vec<[Vec<(f64, f64)>; 2]>,
    /// Edges of the vehicle's path in the left image, left and right: column, row, from near to far.
    path_px: [Vec<(f64, f64)>; 2],
}

/// The images of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Images {
    /// The left image.
    pub left: Vec<u8>,
    /// Disparity in 1/256 px, 0 = unknown.
    pub disparity: Vec<u16>,
}

/// One frame.
#[derive(Debug)]
pub struct Frame {
    line: FrameLine,
    images: Images,
    rig: Rig,
    parts: [OnceLock<Vec<u8>>; 4],
}

impl Frame {
    /// Joins the messages of one frame, whose sizes were checked when they were received.
    pub fn new(
        header: &Header,
        record: FrameRecord,
        images: Images,
        road: &Regions<'_>,
        rig: Rig,
        disparities: usize,
    ) -> Self {
        let ms = |from: u64, to: u64| tidy(to.saturating_sub(from) as f64 * 1e-6);
        let profile = road.profile_px.iter().enumerate().filter(|(_, d)| **d > 0.0);
        let tenths = |(x, y): (f64, f64)| (tidy((x * 10.0).round() / 10.0), tidy((y * 10.0).round() / 10.0));
        let edges = record.path.in_image(&rig, road.profile_px);
        let path_px = edges.map(|edge| edge.into_iter().map(tenths).collect());
        let space = &road.road.space;
        let rounded = |line: Vec<(f64, f64)>| line.into_iter().map(tenths).collect::<Vec<_>>();
        let free = record.free_space_m.iter().map(|area| polygon_in_image(&rig, road.profile_px, area));
        let free: Vec<_> = free.map(rounded).collect();
        let boundaries = record.boundaries.iter().map(|line| line.in_image(&rig, road.profile_px));
        let boundaries: Vec<_> = boundaries.map(|lines| lines.map(rounded)).collect();
        let tilt = record.road.map(|r| tidy((r.horizon_px - rig.cy_px) / rig.focal_px));
        Self {
            line: FrameLine {
                width: header.width as usize,
                height: header.height as usize,
                disparities: disparities.max(1),
                focal_px: rig.focal_px,
                baseline_m: rig.baseline_m,
                cx_px: rig.cx_px,
                latency_ms: ms(header.capture_ns, header.result_ns()),
                stage_ms: header.stamps.map(|s| ms(s.begin_ns, s.end_ns)),
                road_tilt: tilt,
                profile: profile.step_by(PROFILE_STEP).map(|(y, &d)| (y, d)).collect(),
                regions: road.regions.iter().map(RegionLine::new).collect(),
                free_m: space.free().iter().map(|sector| centimetres(sector.far_m)).collect(),
                free_columns_px: (f64::from(space.slope_step) * rig.focal_px).round().max(1.0) as usize,
                free_px: free,
                boundaries_px: boundaries,
                path_px,
                record,
            },
            images,
            rig,
            parts: [const { OnceLock::new() }; 4],
        }
    }

    /// The values of the frame.
    pub fn line(&self) -> &FrameLine {
        &self.line
    }

    /// A part; encoded once for all clients.
    pub fn part(&self, part: Part) -> &[u8] {
        self.parts[part as usize].get_or_init(|| match part {
            Part::Left => jpeg(&self.images.left, self.line.width, self.line.height, ExtendedColorType::L8),
            Part::Disparity => self.disparity(),
            Part::VDisparity => self.v_disparity(),
            Part::Points => self.points(),
        })
    }

    fn map(&self) -> Option<DisparityView<'_>> {
        DisparityView::new(&self.images.disparity, self.line.width, self.line.height)
    }

    fn disparity(&self) -> Vec<u8> {
        let Some(map) = self.map() else { return Vec::new() };
        let step = if map.width() >= HALVED_WIDTH { 2 } else { 1 };
        let rows = (0..map.height()).step_by(step);
        let small: Vec<u16> = rows.flat_map(|y| map.row(y).iter().step_by(step).copied()).collect();
        let (width, height) = (map.width().div_ceil(step), map.height().div_ceil(step));
        picture(&colour::disparity(&small, width, height, self.line.disparities as f32))
    }

    fn v_disparity(&self) -> Vec<u8> {
        let Some(map) = self.map() else { return Vec::new() };
        let counts = v_disparity::of_map(map, self.line.disparities);
        // All three channels are equal: encoding grey takes a third of the time.
        let grey: Vec<u8> = counts.as_bytes().iter().step_by(3).copied().collect();
        jpeg(&grey, counts.width(), counts.height(), ExtendedColorType::L8)
    }

    fn points(&self) -> Vec<u8> {
        let Some(map) = self.map() else { return Vec::new() };
        let every = ((map.as_slice().len() as f64 / POINTS as f64).sqrt() as usize).max(1);
        let parameters = PointCloudParameters {
            step: every,
            // As far as things are told from the road by default, at any speed.
            max_distance_m: Range::of(&self.rig).fast_m,
            ..PointCloudParameters::default()
        };
        let mut points = Vec::new();
        point_cloud::fill(map, &self.images.left, &self.rig, &parameters, &mut points);
        let cm = |metres: f32| ((metres * 100.0).round() as i16).to_le_bytes();
        let bytes = |[x, y, z, grey]: [f32; 4]| {
            let (x, y, z) = (cm(x), cm(y), cm(z));
            [x[0], x[1], y[0], y[1], z[0], z[1], grey as u8, 0]
        };
        points.into_iter().flat_map(bytes).collect()
    }
}

/// Rounds to centimetres, for short JSON; 0 for values that are not finite or negative.
fn centimetres(metres: f32) -> f32 {
    if metres.is_finite() { (metres.max(0.0) * 100.0).round() / 100.0 } else { 0.0 }
}

fn picture(picture: &Picture) -> Vec<u8> {
    jpeg(picture.as_bytes(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
}

/// Encodes a picture; empty if JPEG does not support its size.
pub fn jpeg(pixels: &[u8], width: usize, height: usize, colour: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(pixels.len() / 8);
    let done = JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(
        pixels,
        width as u32,
        height as u32,
        colour,
    );
    match done {
        Ok(()) => bytes,
        Err(error) => {
            tracing::debug!(%error, "cannot encode a picture");
            Vec::new()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::header::Kind;
    use messages::regions::{self, Counts, RoadRecord, Writer};
    use tools::reporting::space::BoundaryLine;

    const RIG: Rig = Rig { focal_px: 400.0, baseline_m: 0.2, cx_px: 32.0, cy_px: 16.0 };

    fn frame() -> Frame {
        let mut header = Header::new(Kind::Regions);
        (header.width, header.height, header.sequence) = (64, 48, 5);
        let profile: Vec<f32> = (0..48).map(|y| if y > 20 { y as f32 / 4.0 } else { 0.0 }).collect();
        let mut memory = vec![0_u64; 4096];
        let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let mut road = RoadRecord::default();
        (road.space.sectors, road.space.slope_step) = (8, 8.0 / 400.0);
        for (sector, far_m) in road.space.free.iter_mut().zip([0.0, 12.504, 0.0, 0.0, 40.0, 40.0, 40.0, 40.0])
        {
            sector.far_m = far_m;
        }
        let bytes = Writer::new(payload, road, &profile, Counts::default()).unwrap().bytes();
        let road = regions::view(&header, &payload[..bytes]).unwrap();
        let images = Images { left: vec![77; 64 * 48], disparity: vec![4 * 256; 64 * 48] };
        let mut record = FrameRecord { sequence: 5, ..FrameRecord::default() };
        // 400 px x 0.2 m / 10 m = 8 px, which the road has in row 32.
        record.path.left_m = vec![[-0.5, 10.0], [-0.5, 1000.0]];
        record.free_space_m = vec![vec![[-0.5, 10.0], [0.5, 10.0]]];
        let boundary =
            BoundaryLine { points_m: vec![[0.5, 10.0]], height_m: vec![0.5], ..BoundaryLine::default() };
        record.boundaries = vec![boundary];
        Frame::new(&header, record, images, &road, RIG, 16)
    }

    #[test]
    fn parts_are_what_their_names_say() {
        let frame = frame();
        let open = |part| image::load_from_memory(frame.part(part)).unwrap();
        let left = open(Part::Left).into_luma8();
        assert_eq!((left.width(), left.height()), (64, 48));
        assert!(left.pixels().all(|p| p[0].abs_diff(77) < 3));
        assert_eq!(open(Part::Disparity).color(), image::ColorType::Rgb8);
        let histogram = open(Part::VDisparity);
        assert_eq!((histogram.width(), histogram.height()), (64, 48));
        // 400 px × 0.2 m ÷ 4 px = 20 m.
        let points = frame.part(Part::Points);
        assert!(!points.is_empty() && points.len().is_multiple_of(8));
        for point in points.chunks_exact(8) {
            assert_eq!((i16::from_le_bytes([point[4], point[5]]), point[6]), (2000, 77));
        }
        assert!(std::ptr::eq(frame.part(Part::Left), frame.part(Part::Left)), "made once");
    }

    #[test]
    fn figures_are_flat_json() {
        let line = serde_json::to_value(frame().line()).unwrap();
        assert_eq!((&line["sequence"], &line["width"]), (&5.into(), &64.into()));
        assert_eq!(line["profile"][0], serde_json::json!([21, 5.25]));
        let free_m: Vec<f32> = serde_json::from_value(line["free_m"].clone()).unwrap();
        assert_eq!(free_m, [0.0, 12.5, 0.0, 0.0, 40.0, 40.0, 40.0, 40.0]);
        assert_eq!(free_m.len() * line["free_columns_px"].as_u64().unwrap() as usize, 64);
        assert_eq!(line["free_px"][0][0], serde_json::json!([12.0, 32.0]));
        assert_eq!(line["boundaries_px"], serde_json::json!([[[[52.0, 32.0]], [[52.0, 12.0]]]]));
        assert_eq!(line["path_px"], serde_json::json!([[[12.0, 32.0]], []]));
        assert_eq!((&line["motion"]["known"], &line["path"]["known"]), (&false.into(), &false.into()));
        assert!(line["obstacles"].is_array() && line["regions"].is_array() && line["alarm"].is_object());
    }
}
