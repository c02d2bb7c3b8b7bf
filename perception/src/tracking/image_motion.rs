//! Motion of an obstacle measured from its image: closing speed from its growth, speed across from its shift.
//!
//! At long range disparity gives little information on speed: at 35 m, with a baseline of 12 cm, an error of
//! a tenth of a pixel is a metre. Meanwhile the image grows by a sixth in two fifths of a second, and a
//! registration determines the scale to a fraction of a percent. At short range, where the depth of
//! an obstacle distorts its image, disparity is more accurate again; the estimated error accounts for that.
//!
//! The middle of a box tells little of the speed across: a box that grows from a part of a car to the whole one moves by half of what
//! it gains, and for some frames to the same side. What is in the box does not move with its sides: a shift of a tenth of a pixel
//! is 2 mm at 20 m.
//!
//! An image patch of a track is stored, and registered to the following images (`registration.rs`). Scale and shift are those since it
//! was stored: from frame to frame they would have the same errors in a fraction of the time.

use super::filter::BearingChange;
use super::filter::ground::Movement;
use super::registration::{ImagePatch, Pose, Rectangle, ReducedImage};
use super::{Track, Tracker};
use crate::image::GreyView;
use crate::region::PixelBox;

/// Largest number of tracks that are measured at the same time: those that are reached first, those that are aside last.
const MAX_TRACKS: usize = 8;
/// What stands counts as this many times as far away.
const STANDING_FACTOR: f64 = 2.0;
/// Smallest closing speed by which that is judged, in m/s, and what is aside counts as this much later, in seconds.
const MIN_CLOSING_M_S: f64 = 1.0;
const ASIDE_S: f64 = 1000.0;

/// Share of the box's width and height that is sampled; its margin shows background.
const INNER_SHARE: f64 = 0.75;

/// Smallest box that is measured, in px.
const MIN_PX: (u32, u32) = (14, 10);

/// Nearer than this, in metres, disparity and box are more accurate.
const MIN_DISTANCE_M: f64 = 5.0;
/// What stands farther to the side than this is not met, in metres;
const MAX_LATERAL_M: f64 = 6.0;
/// nor what remains there for this long, in seconds: about the largest time to collision of a warning with default settings.
const MEETING_S: f64 = 3.0;

/// Time after which a stored image is replaced, in ns, or earlier if the predicted scale change reaches the second value.
const INTERVAL_NS: u64 = 380_000_000;
const MAX_SCALE_CHANGE: f64 = 1.2;
/// Largest time between two compared views, in ns; later, illumination and aspect have changed.
const MAX_AGE_NS: u64 = 900_000_000;
/// After this many images in which it was not found, a patch is replaced.
const MAX_FAILURES: u8 = 2;
/// Bounds of the scale at which a registration starts.
const SCALES: (f64, f64) = (0.7, 1.6);

/// Smallest standard deviation of a scale.
const MIN_SCALE_SIGMA: f64 = 0.004;
/// Where patch and image correlate less, part of either is background, or limbs that swing: errors of the scale, and of the place across
/// in metres, where the correlation is 0.
const SCALE_UNLIKENESS: f64 = 0.35;
/// See [`SCALE_UNLIKENESS`].
const ACROSS_UNLIKENESS_M: f64 = 1.0;
/// Smallest standard deviation of a column, in px.
const MIN_COLUMN_SIGMA_PX: f64 = 0.1;

/// Poses that differ by less, in px and in scale, are the same: where registration settles.
const SAME_PX: f64 = 0.03;
/// See [`SAME_PX`].
const SAME_SCALE: f64 = 5e-4;

/// Uncertainty of the depth of the visible surface behind the tracked near side, in metres.
const DEPTH_OFFSET_M: f64 = 0.4;

/// Standard deviation of a place across that an image tells, in metres: limbs swing, and part of a patch is background;
const ACROSS_SIGMA_M: f64 = 0.005;
/// and of a speed across that a thing seems to have beyond its own, in m/s: other sides come into view.
const ACROSS_SIGMA_M_S: f64 = 0.1;

/// Scales with a larger normalised innovation are rejected.
const GATE_SIGMAS: f64 = 4.0;

/// Scale of an image relative to the stored one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ImageScale {
    scale: f64,
    sigma: f64,
    /// The part of that which the noise of the image causes.
    noise_sigma: f64,
}

/// Shift of an image since it was stored.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ImageShift {
    /// Columns of a point of the thing in the stored image and in this one, in px.
    columns_px: [f64; 2],
    /// Standard deviation of the second one, in px.
    sigma_px: f64,
    /// Time between both frames, in seconds.
    elapsed_s: f64,
    /// Yaw of the camera between both, to the left positive, in rad.
    yaw_rad: f64,
    /// Standard deviation of the place across that comes of what is not alike, in metres.
    unlikeness_m: f64,
}

/// What an image tells of the motion of a thing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ImageMotion {
    scale: Option<ImageScale>,
    shift: Option<ImageShift>,
    /// Whether the image was found in the frame before, too, so that its shift is that of the thing.
    is_followed: bool,
    /// Whether the image was stored for comparison with later ones.
    is_stored: bool,
}

/// A stored image patch of a track.
#[derive(Debug, Default)]
struct Template {
    /// Origin of the track ([`Track::origin`]); 0: none.
    origin: u32,
    time_ns: u64,
    /// Column of its centre, and heading of the camera then.
    column_px: f64,
    heading_rad: f64,
    /// Time of the last request.
    last_used_ns: u64,
    distance_m: f64,
    patch: ImagePatch,
    /// Where it was found last, and when.
    pose: Pose,
    pose_ns: u64,
    /// Consecutive images in which it was not found.
    failures: u8,
}

/// A track in an image.
#[derive(Clone, Copy)]
struct View<'a> {
    /// [`Track::origin`].
    origin: u32,
    distance_m: f64,
    /// The part of its image that is compared.
    rectangle: Rectangle,
    /// A part of the image, and where it begins.
    crop: (GreyView<'a>, (u32, u32)),
    /// Time of this frame, and of the one before.
    time_ns: u64,
    before_ns: u64,
    /// Heading of the camera, in rad, to the left positive.
    heading_rad: f64,
}

/// Measures image motion; memory is allocated once.
#[derive(Debug)]
pub struct ImageMotionMeter {
    templates: [Template; MAX_TRACKS],
    reduced: ReducedImage,
}

/// The lower part of a track's box, with the smoothed width and height of the track, since single boxes extend into the
/// background.
fn rectangle(track: &Track, focal_px: f64) -> Rectangle {
    let PixelBox { x, y, width, height } = track.bounds;
    let [x, y, width, height] = [x, y, width, height].map(f64::from);
    let px = focal_px / track.distance_m();
    let (wide, high) = ((px * track.extent.width_m).min(width), (px * track.extent.height_m).min(height));
    Rectangle {
        centre: [x + (width - 1.0) / 2.0, y + height - 1.0 - high / 2.0],
        size: [INNER_SHARE * wide, INNER_SHARE * high],
    }
}

/// Whether a track is beside the path and stays there until the vehicle arrives.
fn is_aside(track: &Track) -> bool {
    let seconds = (track.distance_m() / track.closing_m_s().max(1e-3)).min(MEETING_S);
    let limit_m = MAX_LATERAL_M + track.extent.width_m / 2.0;
    // What stands and comes in does so by our turn, which has its own path.
    let across_m_s = if track.movement == Movement::Standing { 0.0 } else { track.filter.rate()[0] };
    let now_m = track.lateral_m();
    let then_m = now_m + across_m_s * seconds;
    now_m.abs().min(then_m.abs()) > limit_m && now_m * then_m > 0.0
}

/// Whether poses in consecutive images are the same but for what registration leaves, as in a picture that is repeated: noise, the own
/// pitch and the motion change one that is not.
fn is_same(a: &Pose, b: &Pose) -> bool {
    (a.x - b.x).abs().max((a.y - b.y).abs()) < SAME_PX && (a.scale - b.scale).abs() < SAME_SCALE
}

impl ImageMotionMeter {
    /// A meter for crops of images of up to `width` × `height` px.
    pub fn new(width: usize, height: usize) -> Self {
        Self { templates: Default::default(), reduced: ReducedImage::with_capacity(width, height) }
    }

    /// Forgets all patches.
    pub fn reset(&mut self) {
        for template in &mut self.templates {
            (template.origin, template.time_ns, template.last_used_ns) = (0, 0, 0);
            template.patch.clear();
        }
    }

    /// Compares a view of a track with its patch, and replaces the patch from time to time. `columns`: where what was at a column in
    /// the frame before is expected.
    fn measure(&mut self, view: &View<'_>, columns: impl Fn(f64) -> [f64; 2]) -> ImageMotion {
        let is_its = |template: &Template| template.origin == view.origin && template.time_ns <= view.time_ns;
        let Some(slot) = self.templates.iter().position(is_its) else {
            // Replaces the patch that has not been requested for the longest time.
            let slot = (0..MAX_TRACKS).min_by_key(|&i| (self.templates[i].last_used_ns, i)).unwrap_or(0);
            self.store(slot, view);
            return ImageMotion { is_stored: true, ..ImageMotion::default() };
        };
        let template = &mut self.templates[slot];
        template.last_used_ns = view.time_ns;
        let elapsed_ns = view.time_ns - template.time_ns;
        if elapsed_ns == 0 {
            return ImageMotion::default();
        }
        let scale = template.distance_m / view.distance_m;
        let is_due = elapsed_ns >= INTERVAL_NS || scale >= MAX_SCALE_CHANGE;
        let is_followed = template.pose_ns == view.before_ns;
        let mut found = None;
        if elapsed_ns <= MAX_AGE_NS {
            template.patch.reduce(view.crop, &mut self.reduced);
            let scale = scale.clamp(SCALES.0, SCALES.1);
            let [x, y] = view.rectangle.centre;
            if is_followed {
                let [a, b] = columns(template.pose.x);
                let starts = [a, b, x].map(|x| Pose { x, y: template.pose.y, scale });
                found = template.patch.register(&self.reduced, starts, [2, 1]);
            }
            if found.is_none() && is_due {
                found = template.patch.register(&self.reduced, [Pose { x, y, scale }], [3, 3]);
            }
        }
        if is_followed && found.is_some_and(|found| is_same(&found.pose, &template.pose)) {
            // A source repeats a picture with another time: it tells of no motion, and the next one of more than that of a frame.
            return ImageMotion::default();
        }
        let mut motion = ImageMotion {
            scale: found.map(|found| {
                let noise_sigma = found.scale_sigma.max(MIN_SCALE_SIGMA);
                let unlike = SCALE_UNLIKENESS * (1.0 - found.likeness);
                ImageScale { scale: found.pose.scale, sigma: noise_sigma.hypot(unlike), noise_sigma }
            }),
            shift: found.map(|found| ImageShift {
                columns_px: [template.column_px, found.pose.x],
                sigma_px: found.column_sigma_px.max(MIN_COLUMN_SIGMA_PX),
                elapsed_s: elapsed_ns as f64 * 1e-9,
                yaw_rad: view.heading_rad - template.heading_rad,
                unlikeness_m: ACROSS_UNLIKENESS_M * (1.0 - found.likeness),
            }),
            is_followed,
            is_stored: false,
        };
        match found {
            Some(found) => {
                (template.pose, template.pose_ns, template.failures) = (found.pose, view.time_ns, 0);
            }
            None => template.failures += 1,
        }
        if is_due || template.failures >= MAX_FAILURES {
            self.store(slot, view);
            motion.is_stored = true;
        }
        motion
    }

    fn store(&mut self, slot: usize, view: &View<'_>) {
        let template = &mut self.templates[slot];
        template.patch.store(view.rectangle, view.crop, &mut self.reduced);
        let [x, y] = view.rectangle.centre;
        (template.origin, template.distance_m) = (view.origin, view.distance_m);
        (template.column_px, template.heading_rad) = (x, view.heading_rad);
        (template.time_ns, template.last_used_ns) = (view.time_ns, view.time_ns);
        (template.pose, template.pose_ns, template.failures) = (Pose { x, y, scale: 1.0 }, view.time_ns, 0);
    }
}

impl Tracker {
    /// Measures the image motion of the tracks that are reached first and updates their filters: for each track that was
    /// detected in the frame at `time_ns`, `crop` returns its part of the left image and the position of that
    /// part.
    pub fn measure_image_motion<'a>(
        &mut self,
        meter: &mut ImageMotionMeter,
        time_ns: u64,
        crop: impl Fn(&Track) -> Option<(GreyView<'a>, (u32, u32))>,
    ) {
        self.order.clear();
        for (i, track) in self.tracks.iter_mut().enumerate() {
            track.is_followed = false;
            let (b, z) = (&track.bounds, track.distance_m());
            let is_large = b.width >= MIN_PX.0 && b.height >= MIN_PX.1;
            let is_aside = is_aside(track);
            let may_meet = z >= MIN_DISTANCE_M && (!is_aside || track.movement != Movement::Standing);
            if track.detection.is_some() && is_large && may_meet {
                // What the vehicle would reach first, or what reaches it before.
                let own_m_s = track.filter.own_closing_m_s().max(MIN_CLOSING_M_S);
                let mut seconds = z / track.closing_m_s().max(own_m_s);
                if track.movement == Movement::Standing {
                    // The own motion tells as much.
                    seconds *= STANDING_FACTOR;
                }
                self.order.push((if is_aside { ASIDE_S + seconds } else { seconds }, i as u32));
            }
        }
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let before_ns = time_ns.saturating_sub(self.elapsed_ns);
        for &(_, i) in self.order.iter().take(MAX_TRACKS) {
            let track = &self.tracks[i as usize];
            let Some(crop) = crop(track) else { continue };
            let view = View {
                origin: track.origin,
                distance_m: track.distance_m(),
                rectangle: rectangle(track, self.rig.focal_px),
                crop,
                time_ns,
                before_ns,
                heading_rad: self.heading_rad,
            };
            let motion = meter.measure(&view, |column| self.expected_columns(track, column));
            let bearing = motion.shift.map(|shift| self.bearing_change(track, &shift));
            let followed = bearing.filter(|_| motion.is_followed);
            self.tracks[i as usize].is_followed = followed.is_some();
            let filter = &mut self.tracks[i as usize].filter;
            if let Some(change) = &followed {
                filter.measure_bearing_change(change);
            }
            if let Some(ImageScale { scale, sigma, .. }) = motion.scale {
                // What is behind the near side, but for a part of the image, moves against it as the bearing changes: the image becomes
                // wider or narrower.
                let by_depth = bearing.map_or(0.0, |change| change.by_depth);
                let wide_m = view.rectangle.size[0] / self.rig.focal_px * filter.distance_m();
                let turned = by_depth * DEPTH_OFFSET_M / wide_m;
                filter.measure_scale(scale, sigma.hypot(turned), DEPTH_OFFSET_M, GATE_SIGMAS);
            }
            if motion.is_stored {
                // Of a first image as much is assumed as of the clearest.
                let column_sigma_px = motion
                    .shift
                    .filter(|_| motion.is_followed)
                    .map_or(MIN_COLUMN_SIGMA_PX, |shift| shift.sigma_px);
                let across_sigma_m = column_sigma_px / self.rig.focal_px * filter.distance_m();
                let scale_sigma = motion.scale.map_or(MIN_SCALE_SIGMA, |image| image.noise_sigma);
                filter.store_place(scale_sigma, across_sigma_m.hypot(ACROSS_SIGMA_M));
            }
        }
        // With what the images tell: in this frame, not in the next one.
        self.tracks
            .iter_mut()
            .filter(|track| track.missed == 0)
            .for_each(|track| track.filter.choose_model());
        self.tell_movement();
        self.drop_implausible();
    }

    /// Right of the camera's axis in this frame, in metres: a point of a track that was at `column` in the frame before, if it stands, or
    /// relative to the camera while the own motion is unknown.
    fn standing_m(&self, track: &Track, column: f64, elapsed_s: f64) -> f64 {
        let distance_m = track.distance_m() + track.filter.closing_m_s() * elapsed_s;
        let lateral_m = (column - self.rig.cx_px) / self.rig.focal_px * distance_m;
        self.own_step.map_or(lateral_m, |step| step.place([lateral_m, distance_m])[0])
    }

    /// Columns at which a point of a track that was at `column` in the frame before is expected: if it stands, and as the track moves.
    fn expected_columns(&self, track: &Track, column: f64) -> [f64; 2] {
        let elapsed_s = self.elapsed_ns as f64 * 1e-9;
        let standing_m = self.standing_m(track, column, elapsed_s);
        let moved_m = track.filter.speed_m_s()[0] * elapsed_s;
        [standing_m, standing_m + moved_m]
            .map(|x| self.rig.cx_px + self.rig.focal_px * x / track.distance_m())
    }

    /// Change of a track's bearing that a shift of the image means.
    fn bearing_change(&self, track: &Track, shift: &ImageShift) -> BearingChange {
        let [then, now] = shift.columns_px.map(|column| (column - self.rig.cx_px) / self.rig.focal_px);
        let columns_m = track.distance_m() / self.rig.focal_px * shift.sigma_px;
        let seeming_m = ACROSS_SIGMA_M_S * shift.elapsed_s;
        // What was behind the near side then is now in another direction from it, where the camera has turned.
        let (sine, cosine) = shift.yaw_rad.sin_cos();
        BearingChange {
            tangents: [then, now],
            by_depth: cosine * then + sine - now * (cosine - sine * then),
            elapsed_s: shift.elapsed_s,
            sigma_m: columns_m.hypot(seeming_m).hypot(shift.unlikeness_m).hypot(ACROSS_SIGMA_M),
            depth_sigma_m: DEPTH_OFFSET_M,
        }
    }
}

#[cfg(test)]
mod tests;
