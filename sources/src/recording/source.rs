//! Stereo pairs from a recording.

use super::image_message::{CameraMessage, Kind, camera_message, kind, picture};
use super::index::{Channel, Cut, Index, Stored};
use super::vehicle::VehicleLine;
use super::{ABOUT, LEFT_IMAGE, RIGHT_IMAGE, RecordingError, VEHICLE, VEHICLE_SCHEMA};
use crate::bayer::Bayer;
use crate::picture::{Decoded, Interpretation};
use crate::vehicle::VehicleReading;
use crate::{Geometry, PairSource, SourceError};
use perception::excerpt::{REASON_CHARS, VALUE_CHARS, excerpt};
use perception::rig::Rig;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// Number of chunks kept in memory: left and right image of a pair may be in adjacent chunks.
const KEPT: usize = 2;

/// Time from a message of the vehicle to a pair up to which it is used, in seconds, unless another is set.
const DEFAULT_STALE_S: f64 = 0.5;

/// Pairs, evenly over the recording, in which the depth of 16-bit images is looked for.
const DEPTH_SAMPLES: usize = 4;

/// Topics that an error lists.
const MAX_LISTED: usize = 20;

/// Period of a recording with a single pair: KITTI's 10 Hz.
const DEFAULT_PERIOD_NS: u64 = 100_000_000;

/// An image message: its topic, the place in the file, its log time.
#[derive(Clone, Copy, Debug)]
struct ImagePlace {
    channel: u16,
    place: usize,
    time_ns: u64,
}

/// The stereo pairs of an MCAP file, ordered by time.
#[derive(Debug)]
pub struct RecordingSource {
    index: Index,
    frames: Vec<[ImagePlace; 2]>,
    size: (usize, usize),
    rig: Option<Rig>,
    geometry: Geometry,
    period_ns: u64,
    kept: Vec<(usize, Vec<Stored>)>,
    /// Messages of the vehicle, in the order of their times.
    vehicle: Vec<ImagePlace>,
    stale_s: f64,
    interpretation: Interpretation,
    /// Depth of 16-bit images, where it was looked for.
    depth_found: Option<u8>,
    /// What the vehicle reported at the pair that was read last, and the index of that.
    reading: (u64, VehicleReading),
}

impl RecordingSource {
    /// Opens a recording of `lookout record`, or another file with one image topic for each camera, whose
    /// names differ by `left` and `right`. If there are several, rectified topics are preferred, then
    /// uncompressed ones.
    ///
    /// # Errors
    /// If the file cannot be read or holds no pairs.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let index = Index::open(path)?;
        let no_pairs = |reason: String| RecordingError::NoPairs { path: path.to_owned(), reason };
        let Some(sides) = image_topics(&index) else {
            return Err(no_pairs(without_images(&index)).into());
        };
        let frames = pair_up(places_of(&index, sides[0]), &places_of(&index, sides[1]));
        let Some(first) = frames.first() else {
            return Err(no_pairs("it holds no complete pair of images".into()).into());
        };
        let about = |key: &str| index.metadata(ABOUT)?.get(key)?.parse::<f64>().ok();
        let recorded_rig = || {
            let (focal_px, baseline_m) = (about("focal_px")?, about("baseline_m")?);
            Some(Rig { focal_px, baseline_m, cx_px: about("cx_px")?, cy_px: about("cy_px")? })
        };
        let (first, rig) = (*first, recorded_rig());
        let period_ns = typical_period(&frames);
        let vehicle = index
            .channels()
            .find(|(_, c)| c.topic == VEHICLE && c.schema == VEHICLE_SCHEMA)
            .map(|(id, _)| id);
        let vehicle = vehicle.map(|id| places_of(&index, id)).unwrap_or_default();
        let mut source = Self {
            index,
            frames,
            size: (0, 0),
            rig,
            // A recording of `lookout record` holds pairs as they were matched, with their rig.
            geometry: if rig.is_some() { Geometry::Rectified } else { Geometry::Unknown },
            period_ns,
            kept: Vec::new(),
            vehicle,
            stale_s: DEFAULT_STALE_S,
            interpretation: Interpretation::default(),
            depth_found: None,
            reading: (u64::MAX, VehicleReading::default()),
        };
        let is_rect = source.channel(sides[0]).topic.contains("rect");
        let mut named = (0, 0);
        if source.rig.is_none()
            && let Some([left, right]) = source.cameras()?
        {
            // Fourth column of the right camera's projection matrix: −focal length × baseline.
            let (l, r) = (left.projection, right.projection);
            let rig = Rig { focal_px: l[0], baseline_m: (l[3] - r[3]) / l[0], cx_px: l[2], cy_px: l[6] };
            // Uncalibrated cameras publish zeros.
            let is_calibrated = l[0] > 0.0 && rig.baseline_m.abs() > 0.0;
            source.rig = is_calibrated.then_some(rig);
            // Both topics of a camera, raw and rectified, have the same calibration.
            source.geometry = match is_calibrated {
                true if is_rect || !(left.is_distorted || right.is_distorted) => Geometry::Rectified,
                true => Geometry::Distorted,
                false => Geometry::Unknown,
            };
            named = if is_calibrated { left.size } else { named };
        }
        if let Some(rig) = source.rig {
            source.rig = Some(rig.checked().map_err(|e| no_pairs(format!("its calibration: {e}")))?);
        }
        let sizes =
            [source.image(first[0])?, source.image(first[1])?].map(|(_, width, height)| (width, height));
        if sizes[0] != sizes[1] {
            let [(w, h), (w2, h2)] = sizes;
            return Err(no_pairs(format!("left images have {w}x{h} pixels, right ones {w2}x{h2}")).into());
        }
        source.size = sizes[0];
        let (w, h) = named;
        if named != (0, 0) && (w as usize, h as usize) != source.size {
            let (width, height) = source.size;
            let reason =
                format!("its calibration is for images of {w}x{h} pixels, they have {width}x{height}");
            return Err(no_pairs(reason).into());
        }
        Ok(source)
    }

    /// Log times of the pairs, in order.
    pub fn times_ns(&self) -> Vec<u64> {
        self.frames.iter().map(|f| f[0].time_ns).collect()
    }

    /// The truncated part at the end of the file, if there is one.
    pub fn cut(&self) -> Option<Cut> {
        self.index.cut
    }

    /// The same recording, where a message of the vehicle is used up to `stale_s` from a pair.
    #[must_use]
    pub fn stale_after(self, stale_s: f64) -> Self {
        Self { stale_s, ..self }
    }

    fn channel(&self, id: u16) -> Channel {
        self.index.channel(id).cloned().unwrap_or_else(|| Channel {
            topic: String::new(),
            encoding: String::new(),
            schema: String::new(),
        })
    }

    fn fault(&self, at: ImagePlace, reason: impl Into<String>) -> SourceError {
        let topic = excerpt(&self.channel(at.channel).topic, VALUE_CHARS).into_owned();
        let path = self.index.path().to_owned();
        // A decoder may repeat what it found in a message.
        let reason = excerpt(&reason.into(), REASON_CHARS).into_owned();
        RecordingError::Message { path, topic, time_ns: at.time_ns, reason }.into()
    }

    /// Decodes one image.
    fn picture(&mut self, at: ImagePlace) -> Result<(Decoded, Option<Bayer>), SourceError> {
        let channel = self.channel(at.channel);
        let read = picture(&channel, &self.message(at)?.data);
        read.map_err(|reason| self.fault(at, reason))
    }

    /// Grey levels, width and height of one image.
    fn image(&mut self, at: ImagePlace) -> Result<(Vec<u8>, usize, usize), SourceError> {
        let (decoded, bayer) = self.picture(at)?;
        let (width, height) = (decoded.width, decoded.height);
        let how =
            Interpretation { bits: self.interpretation.bits, bayer: self.interpretation.bayer.or(bayer) };
        Ok((decoded.grey(how), width, height))
    }

    /// The same recording, with values that become grey levels as `how` says. The depth of 16-bit images that it leaves
    /// open is the largest of some pairs, evenly over the recording.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn interpreted(mut self, how: Interpretation) -> Result<Self, SourceError> {
        self.interpretation = how;
        let mut bits = None;
        let step = self.frames.len().div_ceil(DEPTH_SAMPLES).max(1);
        let places: Vec<ImagePlace> = self.frames.iter().step_by(step).flatten().copied().collect();
        for place in places {
            match self.picture(place) {
                Ok((decoded, _)) if decoded.bits().is_none() => break,
                Ok((decoded, _)) => bits = bits.max(decoded.bits()),
                Err(error) if error.is_of_one_pair() => {}
                Err(error) => return Err(error),
            }
        }
        self.interpretation.bits = how.bits.or(bits);
        self.depth_found = if how.bits.is_none() { bits } else { None };
        Ok(self)
    }

    /// The message at a place.
    fn message(&mut self, at: ImagePlace) -> Result<&Stored, SourceError> {
        if !self.kept.iter().any(|(place, _)| *place == at.place) {
            let messages = self.index.load(at.place)?;
            if self.kept.len() == KEPT {
                self.kept.remove(0);
            }
            self.kept.push((at.place, messages));
        }
        let messages = self.kept.iter().find(|(place, _)| *place == at.place).map(|(_, m)| m);
        let message =
            messages.and_then(|m| m.iter().find(|m| m.channel == at.channel && m.time_ns == at.time_ns));
        message.ok_or_else(|| self.fault(at, "the index refers to a message that the file does not hold"))
    }

    /// What the vehicle reported at a time: the message that is nearest to it.
    fn vehicle_at(&mut self, time_ns: u64) -> Result<VehicleReading, SourceError> {
        if self.vehicle.is_empty() {
            return Ok(VehicleReading::default());
        }
        let mut reading = VehicleReading::default();
        let after = self.vehicle.partition_point(|at| at.time_ns < time_ns);
        let near = self.vehicle[after.saturating_sub(1)..self.vehicle.len().min(after + 1)].iter().copied();
        let Some(at) = near.min_by_key(|at| at.time_ns.abs_diff(time_ns)) else { return Ok(reading) };
        let later_s = (i128::from(time_ns) - i128::from(at.time_ns)) as f64 * 1e-9;
        if later_s.abs() > self.stale_s {
            reading.faults.stale = true;
            return Ok(reading);
        }
        let data = &self.message(at)?.data;
        let Some(line) = VehicleLine::parse(data) else {
            // The images are there: a replay goes on without the vehicle's values.
            reading.faults.missing = true;
            return Ok(reading);
        };
        Ok(line.reading(later_s, self.stale_s))
    }

    /// The calibrations of both cameras; `None` if one is missing.
    fn cameras(&mut self) -> Result<Option<[CameraMessage; 2]>, SourceError> {
        let mut found: [Option<CameraMessage>; 2] = [None, None];
        let calibrations = self.index.channels().filter(|(_, c)| kind(c) == Some(Kind::Calibration));
        let wanted: BTreeSet<u16> = calibrations.map(|(id, _)| id).collect();
        for place in 0..self.index.places() {
            if wanted.is_empty() || found.iter().all(Option::is_some) {
                break;
            }
            if !self.index.messages(place).iter().any(|(channel, _)| wanted.contains(channel)) {
                continue;
            }
            for message in self.index.load(place)?.iter().filter(|m| wanted.contains(&m.channel)) {
                let channel = self.channel(message.channel);
                let side = usize::from(channel.topic.contains("right"));
                found[side] = found[side].or_else(|| camera_message(&channel, &message.data));
            }
        }
        let [Some(left), Some(right)] = found else { return Ok(None) };
        Ok(Some([left, right]))
    }
}

/// Why a file without topics of images has no pairs.
fn without_images(index: &Index) -> String {
    if index.cut.is_some() && index.channels().next().is_none() {
        return "no pairs of images: the file is truncated before the end of its first chunk: copy it again"
            .into();
    }
    let there = topics(index);
    format!(
        "no pairs of images: two image topics are needed whose names differ by left and right; the file has {there}"
    )
}

/// The topics of a file, for a message; of many the first.
fn topics(index: &Index) -> String {
    let named = |(_, c): (u16, &Channel)| {
        format!("{} ({})", excerpt(&c.topic, VALUE_CHARS), excerpt(&c.schema, VALUE_CHARS))
    };
    let mut topics: Vec<String> = index.channels().take(MAX_LISTED).map(named).collect();
    match index.channels().count() {
        0 => return "no topics".into(),
        count if count > MAX_LISTED => topics.push(format!("and {} more", count - MAX_LISTED)),
        _ => {}
    }
    topics.join(", ")
}

/// Channel identifiers of the left and the right images.
fn image_topics(index: &Index) -> Option<[u16; 2]> {
    let images: Vec<(u16, &Channel)> =
        index.channels().filter(|(_, c)| matches!(kind(c), Some(Kind::Raw | Kind::Compressed))).collect();
    // Of topics with the same name the first counts.
    let mut ids: HashMap<&str, u16> = HashMap::new();
    for (id, channel) in &images {
        ids.entry(&channel.topic).or_insert(*id);
    }
    let named = |topic: &str| ids.get(topic).copied();
    if let (Some(left), Some(right)) = (named(LEFT_IMAGE), named(RIGHT_IMAGE)) {
        return Some([left, right]);
    }
    let mut pairs: Vec<(bool, bool, [u16; 2])> = Vec::new();
    for (id, channel) in &images {
        if channel.topic.contains("left")
            && let Some(right) = named(&channel.topic.replace("left", "right"))
        {
            let is_lossy = kind(channel) == Some(Kind::Compressed);
            pairs.push((!channel.topic.contains("rect"), is_lossy, [*id, right]));
        }
    }
    pairs.sort();
    pairs.first().map(|(.., ids)| *ids)
}

fn places_of(index: &Index, channel: u16) -> Vec<ImagePlace> {
    let mut found = Vec::new();
    for place in 0..index.places() {
        let own = index.messages(place).iter().filter(|(id, _)| *id == channel);
        found.extend(own.map(|&(channel, time_ns)| ImagePlace { channel, place, time_ns }));
    }
    found.sort_by_key(|p| p.time_ns);
    found
}

/// Pairs each left image with the right image that is nearest in time, if their times differ by at most half a
/// period.
fn pair_up(left: Vec<ImagePlace>, right: &[ImagePlace]) -> Vec<[ImagePlace; 2]> {
    let times: Vec<u64> = left.iter().map(|p| p.time_ns).collect();
    let bound = median_step(&times).map_or(DEFAULT_PERIOD_NS, |ns| ns) / 2;
    let mut next = 0;
    let mut frames = Vec::with_capacity(left.len());
    for image in left {
        let apart = |i: usize| right.get(i).map(|r| r.time_ns.abs_diff(image.time_ns));
        while let (Some(here), Some(further)) = (apart(next), apart(next + 1))
            && further <= here
        {
            next += 1;
        }
        if apart(next).is_some_and(|ns| ns <= bound) {
            frames.push([image, right[next]]);
            next += 1;
        }
    }
    frames
}

fn median_step(times: &[u64]) -> Option<u64> {
    let mut steps: Vec<u64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).copied()
}

fn typical_period(frames: &[[ImagePlace; 2]]) -> u64 {
    let times: Vec<u64> = frames.iter().map(|f| f[0].time_ns).collect();
    median_step(&times).unwrap_or(DEFAULT_PERIOD_NS).max(1)
}

impl PairSource for RecordingSource {
    fn notes(&self) -> Vec<String> {
        let note = |bits: u8| {
            format!(
                "{}: 16-bit images are scaled from {bits} bits to 8; source.bits sets another depth",
                self.index.path().display()
            )
        };
        self.depth_found.map(note).into_iter().collect()
    }

    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn rig(&self) -> Option<Rig> {
        self.rig
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn count(&self) -> Option<u64> {
        Some(self.frames.len() as u64)
    }

    fn period_ns(&self) -> u64 {
        self.period_ns
    }

    fn time_ns(&self, index: u64) -> u64 {
        let time = |i: usize| self.frames.get(i).map(|f| f[0].time_ns);
        let at = usize::try_from(index).ok().and_then(time);
        at.zip(time(0)).map_or(0, |(at, first)| at - first)
    }

    /// That of the pair that was read last; nothing for another.
    fn vehicle(&self, index: u64) -> VehicleReading {
        if self.reading.0 == index { self.reading.1 } else { VehicleReading::default() }
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        let count = self.frames.len() as u64;
        let frame = usize::try_from(index).ok().and_then(|i| self.frames.get(i)).copied();
        let frame = frame.ok_or(SourceError::End { index, count })?;
        for (at, target) in frame.into_iter().zip([left, right]) {
            let (pixels, width, height) = self.image(at)?;
            if (width, height) != self.size || pixels.len() != target.len() {
                let (w, h) = self.size;
                return Err(self.fault(at, format!("{width}x{height} pixels, the first pair has {w}x{h}")));
            }
            target.copy_from_slice(&pixels);
        }
        self.reading = (index, self.vehicle_at(frame[0].time_ns)?);
        Ok(())
    }
}
