//! `regions`: road → recognition. The road model, up to [`MAX_COUNT`] regions (sightings of this frame), up to
//! [`MAX_TRACKS`] tracked obstacles, and their crops of the left image.
//!
//! Payload: [`RoadRecord`] with the free space and the boundaries, the road profile (f32 per image row), the regions
//! ([`RegionRecord`] each), the tracks ([`TrackRecord`] each), the crops (grey values, u8).

use super::track::{MAX_TRACKS, TrackRecord};
use crate::copied::{Records, copy_out};
use crate::header::{
    Header, Kind, MAX_DISPARITY_PX, MAX_PIXELS, MAX_SIDE, MIN_DISPARITY_PX, MessageError, check_box,
};
use crate::range::{
    ANY_U32, Each, FLAG, Field, LATERAL_M, MAX_METRES, MAX_PLANE_PX, METRES, Nested, Ranged, Rule, SHARE,
    Within, ranges, within,
};
use crate::space::SpaceRecord;
use crate::typed::{Message, Output, Written};
use bytemuck::{Pod, Zeroable};

/// Maximum number of regions in a message.
pub const MAX_COUNT: usize = 64;

/// Number of segments of the road ahead. Each has a left and a right edge.
pub const SEGMENTS: usize = 8;

/// Edge of the road on one side of a segment: a step up in height, such as a kerb.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct EdgeRecord {
    /// Height of the step from the road outwards, in metres, positive; 0 if no edge was detected, and then all other
    /// fields are 0.
    pub step_m: f32,
    /// Lateral position in metres; positive to the right of the camera's axis.
    pub lateral_m: f32,
    /// Distance along z, in metres.
    pub distance_m: f32,
    /// Column of its foot on the road in the left image, in px; may lie outside the image.
    pub x_px: f32,
    /// Row of its foot, in px; may lie outside the image.
    pub y_px: f32,
}

/// Maximum magnitude of columns and rows of an edge, in px: lines to it can still be drawn in a frame's time.
const MAX_EDGE_PX: f32 = 1e6;
const EDGE_PX: Within<f32> = within(-MAX_EDGE_PX, MAX_EDGE_PX);

ranges! {
    EdgeRecord as "regions: edge" {
        step_m: within(0.0, MAX_METRES as f32),
        lateral_m: within(-MAX_METRES as f32, MAX_METRES as f32),
        distance_m: within(0.0, MAX_METRES as f32),
        x_px: EDGE_PX,
        y_px: EDGE_PX,
    }
}

impl EdgeRecord {
    /// Column and row of the edge, rounded to whole pixels; `None` if it was not detected.
    fn point(&self) -> Option<(i32, i32)> {
        (self.step_m > 0.0).then(|| (self.x_px.round() as i32, self.y_px.round() as i32))
    }
}

/// The road model of a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RoadRecord {
    /// 1 if a road was detected; else 0, and then all other fields but the counts and
    /// `tracks_since` are 0.
    pub seen: u32,
    /// Number of regions that follow, 0 to [`MAX_COUNT`].
    pub regions: u32,
    /// Number of tracks that follow, 0 to [`MAX_TRACKS`].
    pub tracks: u32,
    /// Changes when the numbers of tracks begin anew: the stage was restarted, or the source's time jumped.
    pub tracks_since: u32,
    /// Slope of the road in v-disparity, px of disparity per row.
    pub slope: f64,
    /// Row of the horizon in the left image, in px; may lie outside the image.
    pub horizon_px: f64,
    /// Roll: change of the road's disparity per column to the right, px per px.
    pub roll: f64,
    /// Share of rows whose disparities support the road, 0 to 1.
    pub confidence: f64,
    /// Height of the camera above the road, in metres.
    pub camera_height_m: f64,
    /// Left and right edge of each segment, the nearest segment first.
    pub edges: [[EdgeRecord; 2]; SEGMENTS],
    /// Free space and boundaries.
    pub space: SpaceRecord,
}

/// Maximum magnitude of changes of the road's disparity, px per px: the largest baseline (20 m) over the lowest camera
/// (0.1 m) is 200.
const MAX_SLOPE: f64 = 1000.0;

/// Slope of the road in v-disparity.
pub(super) const SLOPE: Within<f64> = within(-MAX_SLOPE, MAX_SLOPE);

/// Row of the horizon.
pub(super) const HORIZON_PX: Within<f64> = within(-2.0 * MAX_PLANE_PX, 2.0 * MAX_PLANE_PX);

/// Height of the camera above the road: ten times what can be configured.
pub(super) const CAMERA_HEIGHT_M: Within<f64> = within(0.0, 100.0);

ranges! {
    RoadRecord as "regions: road" {
        seen: FLAG,
        regions: within(0, MAX_COUNT as u32),
        tracks: within(0, MAX_TRACKS as u32),
        tracks_since: ANY_U32,
        slope: SLOPE,
        horizon_px: HORIZON_PX,
        roll: within(-MAX_SLOPE, MAX_SLOPE),
        confidence: SHARE,
        camera_height_m: CAMERA_HEIGHT_M,
        edges: Each(Each(Nested)),
        space: Nested,
    }
}

/// Disparity of the road in a row: not wider than an image.
const PROFILE_PX: Within<f32> = within(0.0, MAX_SIDE as f32);

/// One region: a sighting of what may be an obstacle, in this frame. Boxes are in pixels of the left image; all numbers are
/// finite.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RegionRecord {
    /// Disparity of the near side, in px, above 0.
    pub disparity_px: f64,
    /// Standard deviation of the disparity, in px.
    pub disparity_sigma_px: f64,
    /// Distance of the near side along z, in metres.
    pub distance_m: f64,
    /// Lateral position of the middle of the box, in metres; positive to the right of the camera's axis.
    pub lateral_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Height in metres.
    pub height_m: f64,
    /// Mean confidence of its disparities, 0 to 1.
    pub confidence: f64,
    /// Evidence that it is a real obstacle: natural logarithm of the likelihood ratio.
    pub evidence: f64,
    /// By how much the thing itself ends inside of the left and of the right side of the box, in metres.
    pub inset_m: [f64; 2],
    /// The box: left, top, width, height, in px; within the image.
    pub bounds: [u32; 4],
    /// Number of obstacle pixels in the region.
    pub pixels: u32,
    /// Number of the track that it belongs to; 0 = none.
    pub track: u32,
}

/// Evidence of a region: far beyond certainty in either direction.
const EVIDENCE: Within<f64> = within(-1e6, 1e6);

ranges! {
    RegionRecord as "regions: region" {
        disparity_px: within(MIN_DISPARITY_PX, MAX_DISPARITY_PX),
        disparity_sigma_px: within(0.0, MAX_DISPARITY_PX),
        distance_m: METRES,
        lateral_m: LATERAL_M,
        width_m: METRES,
        height_m: METRES,
        confidence: SHARE,
        evidence: EVIDENCE,
        inset_m: Each(METRES),
        bounds: Each(within(0, MAX_SIDE)),
        pixels: within(0, MAX_PIXELS),
        track: ANY_U32,
    }
}

/// Maximum length of the payload for images of `width` × `height` pixels, in bytes.
pub fn max_payload_bytes(width: usize, height: usize) -> usize {
    fixed_bytes(height)
        + MAX_COUNT * size_of::<RegionRecord>()
        + MAX_TRACKS * size_of::<TrackRecord>()
        + width * height
}

fn fixed_bytes(height: usize) -> usize {
    // Padded to a multiple of eight bytes, so that the records that follow are aligned.
    let numbers = height.next_multiple_of(2);
    size_of::<RoadRecord>() + numbers * size_of::<f32>()
}

/// The parts of a message. Road model, regions and tracks are copied out of it. Profile and crops are read in place: their
/// values were checked, but another process may change them later, so whoever uses them must accept any
/// value.
#[derive(Clone, Copy, Debug)]
pub struct Regions<'a> {
    /// The road model.
    pub road: RoadRecord,
    /// Disparity of the road in each row, in px; 0 above the road.
    pub profile_px: &'a [f32],
    /// The regions, nearest first.
    pub regions: Records<RegionRecord, MAX_COUNT>,
    /// The tracks, oldest first.
    pub tracks: Records<TrackRecord, MAX_TRACKS>,
    crops: &'a [u8],
}

impl<'a> Regions<'a> {
    /// Column and row of each edge of the road, in px; `None` where none was detected.
    pub fn edge_points(&self) -> [[Option<(i32, i32)>; 2]; SEGMENTS] {
        self.road.edges.map(|sides| sides.map(|edge| edge.point()))
    }

    /// Grey values of a track's crop, rows without padding; `None` if it has no crop.
    pub fn crop(&self, track: &TrackRecord) -> Option<&'a [u8]> {
        let [_, _, width, height] = track.crop.map(|v| v as usize);
        let start = track.crop_offset as usize;
        (width > 0 && height > 0).then(|| self.crops.get(start..start + width * height)).flatten()
    }
}

/// Checks a message and returns its parts. Every number is in its range, and all boxes and crops lie within the image and
/// the payload.
///
/// # Errors
/// If the header, the length or any field is invalid.
pub fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Regions<'a>, MessageError> {
    header.check(Kind::Regions)?;
    let height = header.height as usize;
    let fixed = fixed_bytes(height);
    let short = |needed| MessageError::Length { given: payload.len(), needed };
    let (start, rest) = payload.split_at_checked(fixed).ok_or(short(fixed))?;
    let road: RoadRecord = copy_out(start).ok_or(short(fixed))?;
    road.check()?;
    let numbers: &[f32] = bytemuck::try_cast_slice(&start[size_of::<RoadRecord>()..])
        .map_err(|_| MessageError::Value { what: "regions: address", value: payload.as_ptr() as u64 })?;
    let profile_px = &numbers[..height];
    check_all(profile_px, PROFILE_PX, "profile_px")?;
    let (regions, tracks) =
        (road.regions as usize * size_of::<RegionRecord>(), road.tracks as usize * size_of::<TrackRecord>());
    let (records, crops) = rest.split_at_checked(regions + tracks).ok_or(short(fixed + regions + tracks))?;
    let (regions, tracks) = records.split_at(regions);
    let regions = Records::<RegionRecord, MAX_COUNT>::copy_out(regions);
    for region in &regions {
        region.check()?;
        check_box("regions: box of a region", header, &region.bounds)?;
    }
    let tracks = Records::<TrackRecord, MAX_TRACKS>::copy_out(tracks);
    for track in &tracks {
        track.check()?;
        check_box("regions: box of a track", header, &track.bounds)?;
        check_box("regions: crop of a track", header, &track.crop)?;
        let end = u64::from(track.crop_offset) + u64::from(track.crop[2]) * u64::from(track.crop[3]);
        if end > crops.len() as u64 {
            return Err(MessageError::Value { what: "regions: end of a crop", value: end });
        }
    }
    Ok(Regions { road, profile_px, regions, tracks, crops })
}

/// Checks the numbers of a list.
fn check_all(values: &[f32], range: Within<f32>, name: &'static str) -> Result<(), MessageError> {
    let field = Field { record: "regions", name };
    values.iter().try_for_each(|value| range.check(value, field))?;
    Ok(())
}

/// The nearest valid number; 0, which stands for "unknown", for one that is not finite.
fn valid(mut value: f32, range: Within<f32>) -> f32 {
    if !value.is_finite() {
        return 0.0;
    }
    range.limit(&mut value);
    value
}

/// Writes a message incrementally into a payload of [`max_payload_bytes`].
#[derive(Debug)]
pub struct Writer<'a> {
    payload: &'a mut [u8],
    /// Length of the part before the records, in bytes.
    fixed: usize,
    /// Number of regions and of tracks, announced and pushed.
    announced: Counts,
    pushed: Counts,
    crop_bytes: usize,
}

/// Number of records of a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Regions.
    pub regions: usize,
    /// Tracks.
    pub tracks: usize,
}

impl Counts {
    /// Length of the records, in bytes.
    fn bytes(self) -> usize {
        self.regions * size_of::<RegionRecord>() + self.tracks * size_of::<TrackRecord>()
    }
}

impl<'a> Writer<'a> {
    /// Starts a message with the road model, its profile and the number of records that will be pushed. Regions after the
    /// first [`MAX_COUNT`] and tracks after the first [`MAX_TRACKS`] are omitted. Numbers of the profile are moved into
    /// their range.
    ///
    /// # Errors
    /// If the payload is too short.
    pub fn new(
        payload: &'a mut [u8],
        road: RoadRecord,
        profile_px: &[f32],
        counts: Counts,
    ) -> Result<Self, MessageError> {
        let announced =
            Counts { regions: counts.regions.min(MAX_COUNT), tracks: counts.tracks.min(MAX_TRACKS) };
        let numbers = profile_px.len().next_multiple_of(2);
        let fixed = size_of::<RoadRecord>() + numbers * size_of::<f32>();
        let needed = fixed + announced.bytes();
        if payload.len() < needed {
            return Err(MessageError::Length { given: payload.len(), needed });
        }
        let (regions, tracks) = (announced.regions as u32, announced.tracks as u32);
        let road = RoadRecord { regions, tracks, ..road };
        let (start, rest) = payload.split_at_mut(size_of::<RoadRecord>());
        start.copy_from_slice(bytemuck::bytes_of(&road));
        let valid = profile_px.iter().map(|&v| valid(v, PROFILE_PX));
        let padded = valid.chain(std::iter::repeat(0.0));
        let (places, _) = rest[..numbers * size_of::<f32>()].as_chunks_mut();
        for (place, value) in places.iter_mut().zip(padded) {
            *place = f32::to_ne_bytes(value);
        }
        // What is announced and never pushed must not be what another message left there.
        rest[numbers * size_of::<f32>()..][..announced.bytes()].fill(0);
        Ok(Self { payload, fixed, announced, pushed: Counts::default(), crop_bytes: 0 })
    }

    /// Length of the message so far, in bytes.
    pub fn bytes(&self) -> usize {
        self.fixed + self.announced.bytes() + self.crop_bytes
    }

    /// Adds a region. Regions beyond those announced are omitted.
    pub fn push_region(&mut self, region: &RegionRecord) {
        if self.pushed.regions < self.announced.regions {
            let at = self.fixed + self.pushed.regions * size_of::<RegionRecord>();
            self.payload[at..at + size_of::<RegionRecord>()].copy_from_slice(bytemuck::bytes_of(region));
            self.pushed.regions += 1;
        }
    }

    /// Adds a track and the rows of its crop. Without room for the crop, the track is added without it. Returns
    /// whether the crop was added.
    pub fn push_track<'r>(&mut self, track: TrackRecord, mut crop: impl Iterator<Item = &'r [u8]>) -> bool {
        if self.pushed.tracks == self.announced.tracks {
            return false;
        }
        let size = track.crop[2] as usize * track.crop[3] as usize;
        let start = self.bytes();
        let fits = start + size <= self.payload.len();
        let mut record = TrackRecord { crop_offset: self.crop_bytes as u32, ..track };
        if fits {
            let width = (track.crop[2] as usize).max(1);
            for target in self.payload[start..start + size].chunks_exact_mut(width) {
                match crop.next() {
                    Some(row) if row.len() == width => target.copy_from_slice(row),
                    _ => target.fill(0),
                }
            }
            self.crop_bytes += size;
        } else {
            (record.crop, record.crop_offset) = ([0; 4], 0);
        }
        let before = Counts { regions: self.announced.regions, tracks: self.pushed.tracks };
        let at = self.fixed + before.bytes();
        self.payload[at..at + size_of::<TrackRecord>()].copy_from_slice(bytemuck::bytes_of(&record));
        self.pushed.tracks += 1;
        fits
    }
}

/// The typed message.
#[derive(Clone, Copy, Debug)]
pub struct RegionsMessage;

impl Message for RegionsMessage {
    const KIND: Kind = Kind::Regions;
    type View<'a> = Regions<'a>;

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(width: usize, height: usize) -> usize {
        max_payload_bytes(width, height)
    }
}

impl<'a> Output<'a, RegionsMessage> {
    /// Starts a message; see [`Writer::new`].
    ///
    /// # Errors
    /// As [`Writer::new`].
    pub fn begin(
        self,
        road: RoadRecord,
        profile_px: &[f32],
        counts: Counts,
    ) -> Result<Writer<'a>, MessageError> {
        Writer::new(self.payload, road, profile_px, counts)
    }
}

impl Writer<'_> {
    /// Ends the message.
    pub fn finish(self) -> Written {
        Written(self.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::header::Header;

    fn region(x: u32) -> RegionRecord {
        RegionRecord { disparity_px: 5.0, bounds: [x, 2, 4, 5], ..RegionRecord::default() }
    }

    fn track(x: u32, crop: [u32; 4]) -> TrackRecord {
        TrackRecord { disparity_px: 5.0, bounds: [x, 2, 4, 5], crop, ..TrackRecord::default() }
    }

    /// Eight-byte aligned memory, as shared memory is.
    fn message() -> (Header, Vec<u64>) {
        let header = Header { width: 16, height: 9, ..Header::new(Kind::Regions) };
        let mut memory = vec![u64::MAX; max_payload_bytes(16, 9).div_ceil(8)];
        let payload = bytemuck::cast_slice_mut(&mut memory);
        let mut road = RoadRecord { seen: 1, slope: 0.1, ..RoadRecord::default() };
        road.edges[2][1] = EdgeRecord { step_m: 0.12, x_px: 12.4, y_px: 7.6, ..EdgeRecord::default() };
        let profile: Vec<f32> = (0..9).map(|y| y as f32).collect();
        road.space.sectors = 2;
        road.space.free[1].far_m = 12.5;
        let counts = Counts { regions: 1, tracks: 2 };
        let mut writer = Writer::new(payload, road, &profile, counts).unwrap();
        let pixels = [7_u8; 20];
        assert!(writer.push_track(track(1, [1, 2, 4, 5]), pixels.chunks(4)));
        writer.push_region(&region(1));
        writer.push_region(&region(2));
        // This crop is larger than the rest of the payload.
        assert!(!writer.push_track(track(2, [0, 0, 4096, 4096]), std::iter::empty()));
        assert!(!writer.push_track(track(3, [0; 4]), std::iter::empty()), "more than announced");
        let records = size_of::<RegionRecord>() + 2 * size_of::<TrackRecord>();
        assert_eq!(writer.bytes(), fixed_bytes(9) + records + 20);
        (header, memory)
    }

    #[test]
    fn what_is_written_is_read() {
        let (header, memory) = message();
        let regions = view(&header, bytemuck::cast_slice(&memory)).unwrap();
        assert_eq!((regions.road.seen, regions.road.slope), (1, 0.1));
        assert_eq!(regions.edge_points()[2], [None, Some((12, 8))]);
        assert_eq!(regions.profile_px[8], 8.0);
        assert_eq!(regions.road.space.free().iter().map(|s| s.far_m).collect::<Vec<_>>(), [0.0, 12.5]);
        assert_eq!((regions.regions.len(), regions.tracks.len()), (1, 2));
        assert_eq!((regions.regions[0], regions.tracks[1].bounds), (region(1), [2, 2, 4, 5]));
        assert_eq!(regions.crop(&regions.tracks[0]), Some(&[7_u8; 20][..]));
        assert_eq!(regions.crop(&regions.tracks[1]), None);
    }

    #[test]
    fn every_number_outside_its_range_is_refused() {
        let (header, memory) = message();
        let good: Vec<u8> = bytemuck::cast_slice(&memory).to_vec();
        let road: RoadRecord = copy_out(&good).unwrap();
        for (field, wrong) in road.invalid() {
            let mut memory = memory.clone();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            bytes[..size_of::<RoadRecord>()].copy_from_slice(bytemuck::bytes_of(&wrong));
            assert!(view(&header, bytes).is_err(), "{field}: {wrong:?}");
        }
        let at = fixed_bytes(9);
        let region: RegionRecord = copy_out(&good[at..]).unwrap();
        for (field, wrong) in region.invalid() {
            let mut memory = memory.clone();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            bytes[at..at + size_of::<RegionRecord>()].copy_from_slice(bytemuck::bytes_of(&wrong));
            let error = view(&header, bytes).unwrap_err().to_string();
            assert!(error.starts_with("regions: region: ") && error.contains(field), "{error}");
        }
        let at = at + size_of::<RegionRecord>();
        let track: TrackRecord = copy_out(&good[at..]).unwrap();
        for (field, wrong) in track.invalid() {
            let mut memory = memory.clone();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            bytes[at..at + size_of::<TrackRecord>()].copy_from_slice(bytemuck::bytes_of(&wrong));
            let error = view(&header, bytes).unwrap_err().to_string();
            assert!(error.starts_with("regions: track: ") && error.contains(field), "{error}");
        }
        // The first and the last number of the profile.
        for (number, name) in [(0, "profile_px"), (8, "profile_px")] {
            for wrong in [-1e-3_f32, 1e5, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut memory = memory.clone();
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
                let at = size_of::<RoadRecord>() + number * size_of::<f32>();
                bytes[at..at + 4].copy_from_slice(&wrong.to_ne_bytes());
                let error = view(&header, bytes).unwrap_err().to_string();
                assert!(error.starts_with(&format!("regions: {name} is ")), "{error}");
            }
        }
    }

    #[test]
    fn corrupted_messages_are_refused_or_stay_within_bounds() {
        let (header, memory) = message();
        let good: Vec<u8> = bytemuck::cast_slice(&memory).to_vec();
        let mut random = fastrand::Rng::with_seed(11);
        for round in 0..20_000 {
            let mut memory = memory.clone();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            for _ in 0..random.usize(1..6) {
                let at = random.usize(0..good.len().min(size_of::<RoadRecord>() + 100));
                bytes[at] = random.u8(..);
            }
            let header = if round % 5 == 0 {
                Header { width: random.u32(1..40), height: random.u32(1..40), ..header }
            } else {
                header
            };
            let length = if round % 4 == 0 { random.usize(0..good.len()) } else { good.len() };
            if let Ok(regions) = view(&header, &bytes[..length]) {
                for track in &regions.tracks {
                    let crop = regions.crop(track);
                    assert!(crop.is_none_or(|c| c.len() == (track.crop[2] * track.crop[3]) as usize));
                    assert!(track.bounds[0] + track.bounds[2] <= header.width);
                    assert_eq!(regions.profile_px.len(), header.height as usize);
                }
            }
        }
    }
}
