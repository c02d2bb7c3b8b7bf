//! Obstacles over time: association, filtering in disparity space and the distance alarm.

pub mod alarm;
pub mod filter;

use crate::rig::Rig;
use crate::road::Region;
use filter::DisparityFilter;

/// A region of one frame, with what recognition says of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The region.
    pub region: Region,
    /// Score of the recogniser's class; `None` when it did not recognise it.
    pub score: Option<f32>,
}

/// An obstacle that is followed from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Unique as long as the tracker lives, from 1.
    pub id: u32,
    /// The region as last seen.
    pub region: Region,
    /// Filtered disparity and its rate.
    pub filter: DisparityFilter,
    /// Frames in which it was seen.
    pub seen: u32,
    /// Frames in a row in which it was not.
    pub missed: u32,
    /// Latest score of the recogniser's class, kept while frames fail to recognise it again.
    pub score: Option<f32>,
}

impl Track {
    /// Filtered distance, in metres.
    pub fn distance_m(&self, rig: &Rig) -> f64 {
        rig.distance_m(self.filter.disparity_px())
    }

    /// One standard deviation of the distance, in metres.
    pub fn distance_sigma_m(&self, rig: &Rig) -> f64 {
        rig.distance_error_m(self.distance_m(rig), self.filter.sigma_px())
    }

    /// Speed at which the distance shrinks, in m/s; from z = f·B/d follows −ż = f·B·ḋ/d².
    pub fn closing_m_s(&self, rig: &Rig) -> f64 {
        let d = self.filter.disparity_px();
        rig.focal_px * rig.baseline_m * self.filter.rate_px_s() / (d * d)
    }

    /// Time to collision at constant closing speed, in seconds: d/ḋ. `None` when it does not
    /// close in, or so slowly that noise decides.
    pub fn time_to_collision_s(&self) -> Option<f64> {
        let rate = self.filter.rate_px_s();
        (rate > 2.0 * self.filter.rate_sigma_px_s()).then(|| self.filter.disparity_px() / rate)
    }
}

/// How tracks live and die.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerParameters {
    /// A track counts as an obstacle once it was seen in this many frames.
    pub confirm_frames: u32,
    /// It ends after this many frames without a region.
    pub forget_frames: u32,
    /// Least overlap of boxes, 0 to 1, that continues a track.
    pub least_overlap: f64,
    /// At most this many tracks live at once.
    pub greatest_count: usize,
}

impl Default for TrackerParameters {
    fn default() -> Self {
        Self { confirm_frames: 3, forget_frames: 3, least_overlap: 0.2, greatest_count: 128 }
    }
}

/// Detections of a frame for which memory is set aside.
const MOST_DETECTIONS: usize = 64;

/// Follows obstacles, with memory allocated once.
#[derive(Debug)]
pub struct Tracker {
    parameters: TrackerParameters,
    tracks: Vec<Track>,
    pairs: Vec<(f64, usize, usize)>,
    taken: Vec<bool>,
    next_id: u32,
    last_ns: Option<u64>,
}

impl Tracker {
    /// A tracker without tracks.
    pub fn new(parameters: TrackerParameters) -> Self {
        Self {
            tracks: Vec::with_capacity(parameters.greatest_count),
            pairs: Vec::with_capacity(parameters.greatest_count * MOST_DETECTIONS),
            taken: Vec::with_capacity(MOST_DETECTIONS),
            parameters,
            next_id: 1,
            last_ns: None,
        }
    }

    /// All tracks, oldest first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Whether a track counts as an obstacle.
    pub fn is_confirmed(&self, track: &Track) -> bool {
        track.seen >= self.parameters.confirm_frames
    }

    /// Takes in the regions of the frame at `time_ns` and gives all tracks, oldest first. A time
    /// that does not grow starts anew.
    pub fn update(&mut self, time_ns: u64, detections: &[Detection]) -> &[Track] {
        let elapsed_s = match self.last_ns {
            Some(last) if time_ns > last => (time_ns - last) as f64 * 1e-9,
            Some(_) => {
                self.tracks.clear();
                0.0
            }
            None => 0.0,
        };
        self.last_ns = Some(time_ns);
        for track in &mut self.tracks {
            track.filter.predict(elapsed_s);
        }

        // All plausible pairs, best overlap first.
        self.pairs.clear();
        for (t, track) in self.tracks.iter().enumerate() {
            for (d, detection) in detections.iter().enumerate() {
                let overlap = track.region.bounds.overlap(&detection.region.bounds);
                let expected = track.filter.disparity_px();
                // What noise and a change of speed explain.
                let spread = track.filter.sigma_px().hypot(detection.region.disparity_sigma_px);
                let near = 1.5 + 0.15 * expected + 3.0 * spread;
                if overlap >= self.parameters.least_overlap
                    && (detection.region.disparity_px - expected).abs() <= near
                {
                    self.pairs.push((overlap, t, d));
                }
            }
        }
        self.pairs.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        self.taken.clear();
        self.taken.resize(detections.len(), false);
        for track in &mut self.tracks {
            track.missed += 1;
        }
        for &(_, t, d) in &self.pairs {
            let track = &mut self.tracks[t];
            if self.taken[d] || track.missed == 0 {
                continue;
            }
            self.taken[d] = true;
            let detection = &detections[d];
            track.filter.update(detection.region.disparity_px, detection.region.disparity_sigma_px);
            track.region = detection.region;
            track.seen = track.seen.saturating_add(1);
            track.missed = 0;
            track.score = detection.score.or(track.score);
        }
        let forget = self.parameters.forget_frames;
        // One that was never confirmed ends at its first miss.
        let confirm = self.parameters.confirm_frames;
        self.tracks.retain(|t| t.missed == 0 || (t.seen >= confirm && t.missed < forget));
        for (detection, taken) in detections.iter().zip(&self.taken) {
            if !taken && self.tracks.len() < self.parameters.greatest_count {
                self.tracks.push(Track {
                    id: self.next_id,
                    region: detection.region,
                    filter: DisparityFilter::new(
                        detection.region.disparity_px,
                        detection.region.disparity_sigma_px,
                    ),
                    seen: 1,
                    missed: 0,
                    score: detection.score,
                });
                self.next_id = self.next_id.wrapping_add(1).max(1);
            }
        }
        &self.tracks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::road::PixelBox;

    const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };

    fn detection(x: u32, distance_m: f64) -> Detection {
        let region = Region {
            bounds: PixelBox { x, y: 200, width: 60, height: 50 },
            disparity_px: RIG.disparity_px(distance_m),
            disparity_sigma_px: 0.15,
            distance_m,
            lateral_m: RIG.lateral_m(f64::from(x) + 30.0, distance_m),
            width_m: 1.8,
            height_m: 1.5,
            pixels: 2000,
            confidence: 0.9,
        };
        Detection { region, score: None }
    }

    const PERIOD_NS: u64 = 80_000_000;

    #[test]
    fn an_approaching_car_keeps_its_identity_and_gives_its_speed() {
        let mut tracker = Tracker::new(TrackerParameters::default());
        let mut random = fastrand::Rng::with_seed(2);
        for frame in 0..40_u64 {
            let distance = 30.0 - 0.4 * frame as f64;
            let mut car = detection(300, distance);
            car.region.disparity_px += f64::from(random.f32()) * 0.2 - 0.1;
            tracker.update(frame * PERIOD_NS, &[detection(40, 50.0), car]);
        }
        let track = tracker.tracks.iter().find(|t| t.region.bounds.x == 300).unwrap();
        assert_eq!((track.seen, track.missed), (40, 0));
        assert!((track.distance_m(&RIG) - 14.4).abs() < 0.5, "{}", track.distance_m(&RIG));
        // 0.4 m in 80 ms.
        assert!((track.closing_m_s(&RIG) - 5.0).abs() < 1.0, "{}", track.closing_m_s(&RIG));
        let ttc = track.time_to_collision_s().unwrap();
        assert!((ttc - 2.9).abs() < 0.6, "{ttc}");
        let standing = tracker.tracks.iter().find(|t| t.region.bounds.x == 40).unwrap();
        assert_eq!(standing.time_to_collision_s(), None);
        assert_ne!(standing.id, track.id);
    }

    #[test]
    fn a_car_that_closes_in_fast_is_not_lost() {
        let mut tracker = Tracker::new(TrackerParameters::default());
        let mut random = fastrand::Rng::with_seed(3);
        let (mut distance, mut frame) = (45.0, 0);
        while distance > 4.0 {
            let mut car = detection(300, distance);
            car.region.disparity_px += f64::from(random.f32()) * 0.5 - 0.25;
            tracker.update(frame * PERIOD_NS, &[car]);
            if distance < 15.0 {
                let track = &tracker.tracks[0];
                assert_eq!((tracker.tracks.len(), track.id, track.missed), (1, 1, 0), "at {distance} m");
                let (ttc, truth) = (track.time_to_collision_s().unwrap(), distance / 15.0);
                assert!((ttc - truth).abs() < 0.25 * truth, "{ttc} s for {truth} s at {distance} m");
            }
            distance -= 15.0 * 0.08;
            frame += 1;
        }
    }

    #[test]
    fn tracks_are_confirmed_bridged_and_forgotten() {
        let mut tracker = Tracker::new(TrackerParameters::default());
        let mut time = 0;
        let mut step = |tracker: &mut Tracker, detections: &[Detection]| {
            time += PERIOD_NS;
            tracker.update(time, detections).to_vec()
        };
        let car = [detection(300, 20.0)];
        let first = step(&mut tracker, &car)[0].id;
        assert!(!tracker.is_confirmed(&tracker.tracks[0]));
        step(&mut tracker, &car);
        step(&mut tracker, &car);
        assert!(tracker.is_confirmed(&tracker.tracks[0]));
        // Two frames without it are bridged, three are not.
        step(&mut tracker, &[]);
        assert_eq!(step(&mut tracker, &[])[0].missed, 2);
        assert_eq!(step(&mut tracker, &car)[0].id, first);
        for _ in 0..3 {
            step(&mut tracker, &[]);
        }
        assert_eq!(step(&mut tracker, &[]), []);
        assert_ne!(step(&mut tracker, &car)[0].id, first);
        // A track of one frame leaves at once.
        assert_eq!(step(&mut tracker, &[]), []);
    }

    #[test]
    fn one_region_continues_one_track() {
        let mut tracker = Tracker::new(TrackerParameters::default());
        tracker.update(1, &[detection(300, 20.0), detection(310, 20.0)]);
        let tracks = tracker.update(2, &[detection(302, 20.0)]).to_vec();
        assert_eq!(tracks.iter().filter(|t| t.missed == 0).count(), 1);
        // The same box at another depth is something else.
        let tracks = tracker.update(3, &[detection(302, 5.0)]).to_vec();
        assert!(tracks.iter().all(|t| t.seen == 1), "{tracks:?}");
    }

    #[test]
    fn a_score_is_kept_and_a_jump_back_in_time_starts_anew() {
        let mut tracker = Tracker::new(TrackerParameters::default());
        let seen = Detection { score: Some(4.0), ..detection(300, 20.0) };
        tracker.update(1_000, &[seen]);
        assert_eq!(tracker.update(2_000, &[detection(300, 20.0)])[0].score, Some(4.0));
        let tracks = tracker.update(500, &[detection(300, 20.0)]);
        assert_eq!((tracks.len(), tracks[0].seen), (1, 1));
    }
}
