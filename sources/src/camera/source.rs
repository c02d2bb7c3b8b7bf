//! Stereo pairs from live cameras.

use super::connection::{Action, Connection, ConnectionParameters};
use super::exposure::{ExposureControl, ExposureParameters};
use super::pairing::{Counts, Pairing, Verdict};
use super::{Camera, Exposure, Opener, Taken};
use crate::{LiveSource, PairSource, Readiness, SourceError};
use perception::rig::Rig;
use std::time::Duration;

/// Brightness is sampled every this many pixels and pairs.
const BRIGHTNESS_STEP: usize = 61;

/// Exposure mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExposureMode {
    /// Set once at start: the camera's own automatic exposure, or fixed values.
    Once(Exposure),
    /// Controlled here, with the same exposure for both cameras.
    Matched(ExposureParameters),
}

/// How the cameras are operated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Width and height of one image, in pixels.
    pub size: (usize, usize),
    /// Period of the pairs, in nanoseconds.
    pub period_ns: u64,
    /// Whether one camera delivers both images side by side, the left one first.
    pub side_by_side: bool,
    /// Largest difference between the exposure times of a pair, in nanoseconds.
    pub skew_ns: u64,
    /// Reconnection of lost cameras.
    pub connection: ConnectionParameters,
    /// Exposure mode.
    pub exposure: ExposureMode,
}

/// A camera with its connection state and buffers.
struct Link {
    camera: Option<Box<dyn Camera>>,
    connection: Connection,
    /// Two images: one may wait for its partner while the other is being written.
    images: [Vec<u8>; 2],
    /// Index of the image to write next.
    free: usize,
    trouble: Option<String>,
}

/// A complete pair: the image index of each side, and the exposure time.
#[derive(Clone, Copy, Debug)]
struct Ready {
    images: [usize; 2],
    time_ns: u64,
}

/// A [`PairSource`] of live cameras. Allocates nothing once the cameras are open.
pub struct CameraSource {
    opener: Box<dyn Opener>,
    settings: Settings,
    /// The monotonic clock, in nanoseconds.
    clock: fn() -> u64,
    links: Vec<Link>,
    pairing: Pairing,
    ready: Option<Ready>,
    /// Exposure time of the last pair. The source time equals the capture clock, so that it continues when
    /// this process is replaced.
    last_ns: u64,
    control: Option<ExposureControl>,
    /// Whether it was reported that the cameras expose at different times.
    is_out_of_step: bool,
    /// A fault that was not reported yet; empty after recovery.
    pending_fault: Option<String>,
}

impl CameraSource {
    /// Opens nothing yet: cameras are opened while waiting for pairs, as often as needed.
    pub fn new(opener: Box<dyn Opener>, settings: Settings, clock: fn() -> u64) -> Self {
        let (width, height) = settings.size;
        let (cameras, pixels) =
            if settings.side_by_side { (1, 2 * width * height) } else { (2, width * height) };
        let link = || Link {
            camera: None,
            connection: Connection::new(settings.connection),
            images: [vec![0; pixels], vec![0; pixels]],
            free: 0,
            trouble: None,
        };
        let control = match settings.exposure {
            ExposureMode::Matched(parameters) => Some(ExposureControl::new(parameters)),
            ExposureMode::Once(_) => None,
        };
        Self {
            opener,
            settings,
            clock,
            links: (0..cameras).map(|_| link()).collect(),
            pairing: Pairing::new(settings.skew_ns),
            ready: None,
            last_ns: 0,
            control,
            is_out_of_step: false,
            pending_fault: None,
        }
    }

    /// Pair counters since the start.
    pub fn counts(&self) -> Counts {
        self.pairing.counts()
    }

    /// How often a camera was lost after it had delivered frames.
    pub fn losses(&self) -> u64 {
        self.links.iter().map(|link| link.connection.losses()).sum()
    }

    fn camera_size(&self) -> (usize, usize) {
        let (width, height) = self.settings.size;
        if self.settings.side_by_side { (2 * width, height) } else { (width, height) }
    }

    /// Queues a fault; both cameras may report one.
    fn report_fault(&mut self, text: String) {
        match &mut self.pending_fault {
            Some(pending_fault) if !pending_fault.is_empty() => {
                pending_fault.push_str("; ");
                pending_fault.push_str(&text);
            }
            pending_fault => *pending_fault = Some(text),
        }
    }

    /// A camera failed: closes it and schedules the next attempt.
    fn fail(&mut self, side: usize, reason: &str) {
        let link = &mut self.links[side];
        link.camera = None;
        let wait_ns = link.connection.failed((self.clock)());
        if link.trouble.as_deref() != Some(reason) {
            link.trouble = Some(reason.to_owned());
            self.report_fault(format!(
                "{reason}; next attempt in {:.1} s, then at growing intervals",
                wait_ns as f64 * 1e-9
            ));
        }
        self.pairing.reset(side);
    }

    fn open(&mut self, side: usize) {
        let size = self.camera_size();
        let exposure = match (&self.control, self.settings.exposure) {
            (Some(control), _) => control.exposure(),
            (None, ExposureMode::Once(exposure)) => exposure,
            (None, ExposureMode::Matched(_)) => Exposure::Automatic,
        };
        match self.opener.open(side, size) {
            Ok(mut camera) => {
                // Images with another exposure are better than none.
                if let Err(error) = camera.set_exposure(exposure) {
                    self.report_fault(error.to_string());
                }
                let link = &mut self.links[side];
                link.camera = Some(camera);
                link.connection.opened((self.clock)());
                self.pairing.reset(side);
            }
            Err(error) => self.fail(side, &error.to_string()),
        }
    }

    /// Opens, closes or reads one camera, as its connection state requires.
    fn service(&mut self, side: usize, patience: Duration) {
        match self.links[side].connection.action((self.clock)()) {
            Action::Wait => {}
            Action::Open => self.open(side),
            Action::Close => {
                let silent_s = self.settings.connection.silence_ns as f64 * 1e-9;
                let name = ["left", "right"][side.min(1)];
                self.fail(side, &format!("the {name} camera has delivered no frame for {silent_s:.1} s"));
            }
            Action::Grab => {
                let link = &mut self.links[side];
                let Some(camera) = &mut link.camera else { return };
                match camera.grab(patience, &mut link.images[link.free]) {
                    Ok(Some(taken)) => self.take(side, taken),
                    Ok(None) => {}
                    Err(error) => self.fail(side, &error.to_string()),
                }
            }
        }
    }

    /// A frame was written to the free image of a side.
    fn take(&mut self, side: usize, taken: Taken) {
        let link = &mut self.links[side];
        link.connection.frame((self.clock)());
        let was_lost = link.trouble.take().is_some();
        if was_lost && self.links.iter().all(|link| link.trouble.is_none()) {
            self.pending_fault = Some(String::new());
        }
        let own = self.links[side].free;
        if self.settings.side_by_side {
            self.ready = Some(Ready { images: [own, own], time_ns: taken.time_ns });
            return;
        }
        match self.pairing.offer(side, taken.time_ns) {
            Verdict::Drop => {}
            Verdict::Hold => self.links[side].free = 1 - own,
            Verdict::Pair { .. } => {
                if std::mem::take(&mut self.is_out_of_step) {
                    self.pending_fault = Some(String::new());
                }
                let other = 1 - side;
                let mut images = [own; 2];
                images[other] = 1 - self.links[other].free;
                self.ready = Some(Ready { images, time_ns: taken.time_ns });
            }
        }
        if !self.is_out_of_step
            && let Some(nearest_ns) = self.pairing.out_of_step()
        {
            self.is_out_of_step = true;
            let ms = |ns: u64| ns as f64 * 1e-6;
            self.report_fault(format!(
                "no pairs: left and right expose {:.1} ms apart, camera.skew_ms = {} allows less: trigger both cameras \
                 together, or raise camera.skew_ms (below half a period, {:.1} ms)",
                ms(nearest_ns),
                ms(self.settings.skew_ns),
                ms(self.settings.period_ns) / 2.0
            ));
        }
    }

    /// Updates the exposure control with the brightness of a pair.
    fn control_exposure(&mut self, left: &[u8], right: &[u8]) {
        let Some(control) = &mut self.control else { return };
        let samples = left.iter().chain(right).step_by(BRIGHTNESS_STEP);
        let (sum, count) = samples.fold((0_u64, 0_u64), |(sum, n), &v| (sum + u64::from(v), n + 1));
        let Some(exposure) = control.pair(sum as f64 / count.max(1) as f64) else { return };
        let mut refused = None;
        for camera in self.links.iter_mut().filter_map(|link| link.camera.as_mut()) {
            if let Err(error) = camera.set_exposure(exposure) {
                refused = Some(error.to_string());
            }
        }
        if let Some(text) = refused {
            self.report_fault(text);
        }
    }
}

impl LiveSource for CameraSource {
    fn wait(&mut self, patience: Duration) -> Readiness {
        // An unread pair is replaced by the next.
        self.ready = None;
        // Serves the side first whose partner is already held.
        let first = usize::from(self.links.len() > 1 && self.pairing.holds(0));
        self.service(first, patience);
        if self.links.len() > 1 && self.ready.is_none() {
            // When the first is lost, waits on this one.
            let is_open = self.links[first].connection.is_open();
            self.service(1 - first, if is_open { Duration::from_millis(1) } else { patience });
        }
        if self.links.iter().all(|link| !link.connection.is_open()) {
            // No camera is open: sleep, so that the caller's loop does not spin.
            std::thread::sleep(patience);
        }
        match (self.ready, self.pending_fault.take()) {
            (_, Some(pending_fault)) if pending_fault.is_empty() => Readiness::Recovered,
            (_, Some(pending_fault)) => Readiness::Trouble(pending_fault),
            (Some(ready), None) => Readiness::Pair { capture_ns: ready.time_ns },
            (None, None) => Readiness::Nothing,
        }
    }
}

impl PairSource for CameraSource {
    fn size(&self) -> (usize, usize) {
        self.settings.size
    }

    fn rig(&self) -> Option<Rig> {
        None
    }

    fn count(&self) -> Option<u64> {
        None
    }

    fn period_ns(&self) -> u64 {
        self.settings.period_ns
    }

    fn time_ns(&self, _index: u64) -> u64 {
        self.last_ns
    }

    fn live(&mut self) -> Option<&mut dyn LiveSource> {
        Some(self)
    }

    /// The pair that [`LiveSource::wait`] has found; `index` is ignored.
    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        let Some(ready) = self.ready.take() else { return Err(SourceError::End { index, count: index }) };
        let (width, height) = self.settings.size;
        if left.len() != width * height || right.len() != width * height {
            return Err(SourceError::End { index, count: 0 });
        }
        if self.settings.side_by_side {
            let both = self.links[0].images[ready.images[0]].chunks_exact(2 * width);
            let targets = left.chunks_exact_mut(width).zip(right.chunks_exact_mut(width));
            for (row, (l, r)) in both.zip(targets) {
                l.copy_from_slice(&row[..width]);
                r.copy_from_slice(&row[width..]);
            }
        } else {
            left.copy_from_slice(&self.links[0].images[ready.images[0]]);
            right.copy_from_slice(&self.links[1].images[ready.images[1]]);
        }
        self.last_ns = self.last_ns.max(ready.time_ns);
        self.control_exposure(left, right);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake::{Event, FakeRig, now_ns};
    use super::*;

    const MS: u64 = 1_000_000;

    fn settings(side_by_side: bool) -> Settings {
        Settings {
            size: (4, 3),
            period_ns: 33 * MS,
            side_by_side,
            skew_ns: 2 * MS,
            connection: ConnectionParameters {
                silence_ns: 200 * MS,
                retry_initial_ns: 100 * MS,
                retry_max_ns: 400 * MS,
            },
            exposure: ExposureMode::Once(Exposure::Automatic),
        }
    }

    /// Runs a script to its end. Returns the grey levels of the pairs and the reported faults.
    fn play(source: &mut CameraSource, rig: &FakeRig) -> (Vec<(u8, u8)>, Vec<String>) {
        let (mut pairs, mut reported) = (Vec::new(), Vec::new());
        let (mut left, mut right) = (vec![0; 12], vec![0; 12]);
        while !rig.is_over() {
            match source.wait(Duration::from_millis(5)) {
                Readiness::Pair { .. } => {
                    source.read(pairs.len() as u64, &mut left, &mut right).unwrap();
                    pairs.push((left[11], right[11]));
                }
                Readiness::Trouble(text) => reported.push(text),
                Readiness::Recovered => reported.push("recovered".into()),
                Readiness::Nothing => {}
            }
        }
        (pairs, reported)
    }

    #[test]
    fn two_cameras_become_pairs_of_the_same_time() {
        let frames = |delay: u64| {
            (1..40_u64).map(move |n| Event::Frame { at_ns: n * 33 * MS + delay, level: n as u8 })
        };
        let rig = FakeRig::new([frames(0).collect(), frames(MS).collect()]);
        let mut source = CameraSource::new(rig.opener(), settings(false), now_ns);
        let (pairs, reported) = play(&mut source, &rig);
        assert!(pairs.iter().all(|(l, r)| l == r), "{pairs:?}");
        assert!(pairs.len() >= 38 && reported.is_empty(), "{} pairs, {reported:?}", pairs.len());
        assert_eq!(source.counts().worst_skew_ns, MS);
        assert_eq!(source.time_ns(0), 39 * 33 * MS + MS, "source time follows the exposures");
    }

    #[test]
    fn dropped_and_jittered_frames_never_make_a_wrong_pair() {
        let side = |lost: &'static [u64], jitter: u64| {
            (1..60_u64)
                .filter(|n| !lost.contains(n))
                .map(move |n| Event::Frame { at_ns: n * 33 * MS + (n * 7919 % 10) * jitter, level: n as u8 })
                .collect()
        };
        let rig = FakeRig::new([side(&[10, 11], MS / 10), side(&[20, 30, 31, 32], 0)]);
        let mut source = CameraSource::new(rig.opener(), settings(false), now_ns);
        let (pairs, _) = play(&mut source, &rig);
        assert!(pairs.iter().all(|(l, r)| l == r), "{pairs:?}");
        assert!(pairs.len() >= 52, "{}", pairs.len());
        let single = source.counts().single;
        assert!(single[0] >= 4 && single[1] >= 2, "{single:?}");
    }

    #[test]
    fn cameras_that_expose_at_different_times_are_told_once() {
        let frames = |delay: u64, range: std::ops::Range<u64>| {
            range.map(move |n| Event::Frame { at_ns: n * 33 * MS + delay, level: n as u8 })
        };
        // They drift into step at last.
        let right = frames(11 * MS, 1..200).chain(frames(0, 200..240)).collect();
        let rig = FakeRig::new([frames(0, 1..240).collect(), right]);
        let mut source = CameraSource::new(rig.opener(), settings(false), now_ns);
        let (pairs, reported) = play(&mut source, &rig);
        assert_eq!(reported.len(), 2, "{reported:?}");
        for part in ["left and right expose 11.0 ms apart", "camera.skew_ms = 2 ", "half a period, 16.5 ms"] {
            assert!(reported[0].contains(part), "{part}: {}", reported[0]);
        }
        assert!(reported[1] == "recovered" && pairs.len() >= 35, "{reported:?}, {} pairs", pairs.len());
    }

    #[test]
    fn a_lost_camera_is_opened_again_and_pairs_go_on() {
        let frames = |range: std::ops::Range<u64>| {
            range.map(|n| Event::Frame { at_ns: n * 33 * MS, level: n as u8 }).collect::<Vec<_>>()
        };
        // The right camera is unplugged after frame 20; opening fails twice; it is back from frame 60 on.
        let mut right = frames(1..21);
        right.extend([Event::Unplug { at_ns: 20 * 33 * MS + MS }, Event::Plug { at_ns: 50 * 33 * MS }]);
        right.extend(frames(51..90));
        let rig = FakeRig::new([frames(1..90), right]);
        let mut source = CameraSource::new(rig.opener(), settings(false), now_ns);
        let (pairs, reported) = play(&mut source, &rig);
        assert!(pairs.iter().all(|(l, r)| l == r));
        assert!(pairs.iter().any(|p| p.0 == 19) && pairs.iter().any(|p| p.0 == 85), "{pairs:?}");
        assert!(reported[0].contains("fake right: unplugged"), "{reported:?}");
        assert_eq!(reported.last().map(String::as_str), Some("recovered"), "{reported:?}");
        assert_eq!(source.losses(), 1);
    }

    #[test]
    fn both_cameras_may_be_lost_at_once() {
        let rig = FakeRig::new([vec![Event::Unplug { at_ns: MS }], vec![Event::Unplug { at_ns: MS }]]);
        let mut source = CameraSource::new(rig.opener(), settings(false), now_ns);
        assert_eq!(source.wait(Duration::from_millis(5)), Readiness::Nothing, "both are opened");
        let Readiness::Trouble(reported) = source.wait(Duration::from_millis(5)) else {
            panic!("both are gone")
        };
        assert!(
            reported.contains("fake left: unplugged") && reported.contains("fake right: unplugged"),
            "{reported}"
        );
    }

    #[test]
    fn a_silent_camera_is_opened_again() {
        let frames = |range: std::ops::Range<u64>| {
            range.map(|n| Event::Frame { at_ns: n * 33 * MS, level: n as u8 }).collect::<Vec<_>>()
        };
        let mut left = frames(1..20);
        left.extend(frames(50..70));
        let rig = FakeRig::new([left, frames(1..70)]);
        let mut source = CameraSource::new(rig.opener(), settings(false), now_ns);
        let (pairs, reported) = play(&mut source, &rig);
        assert!(reported[0].contains("left camera has delivered no frame for 0.2 s"), "{reported:?}");
        assert!(pairs.iter().any(|p| p.0 == 66), "{pairs:?}");
        assert!(rig.opened(0) >= 2);
    }

    #[test]
    fn one_camera_may_give_both_images() {
        let frames = (1..20_u64).map(|n| Event::Frame { at_ns: n * 33 * MS, level: n as u8 }).collect();
        let rig = FakeRig::new([frames, Vec::new()]);
        let mut source = CameraSource::new(rig.opener(), settings(true), now_ns);
        // The fake makes the right half 100 levels brighter.
        let (pairs, _) = play(&mut source, &rig);
        assert!(pairs.len() >= 18 && pairs.iter().all(|(l, r)| l + 100 == *r), "{pairs:?}");
    }

    #[test]
    fn matched_exposure_sets_both_cameras_alike() {
        let frames = || (1..60_u64).map(|n| Event::Frame { at_ns: n * 33 * MS, level: 20 }).collect();
        let rig = FakeRig::new([frames(), frames()]);
        let exposure = ExposureMode::Matched(ExposureParameters { max_exposure_us: 10_000, max_gain: 4 });
        let settings = Settings { exposure, ..settings(false) };
        let mut source = CameraSource::new(rig.opener(), settings, now_ns);
        play(&mut source, &rig);
        let set = rig.exposures();
        assert_eq!(set[0], set[1]);
        // The image stays dark whatever is set, so the control ends at its limits.
        assert_eq!(set[0].last(), Some(&Exposure::Fixed { time_us: 10_000, gain: 4 }));
    }
}
