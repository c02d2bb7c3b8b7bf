//! Random faults in the time of a source, drawn from a seed: gaps in which the scene moves on, jumps of the stamp while it
//! does not, repeated frames and stamps, extreme stamps.
//!
//! [`FaultyClock`] turns the frames of a scene into what a faulty source would show of it: which frames, in which order,
//! with which stamps. Scenes follow each other endlessly on one clock.

use serde::Serialize;

/// A fault in the time of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeFault {
    /// No frames for 0.2 to 60 s, while the scene moves on: a camera that was away.
    Gap,
    /// The stamp jumps forward by 0.2 to 60 s, the scene does not.
    JumpForward,
    /// The stamp jumps back by 1 ms to 60 s, the scene does not.
    JumpBack,
    /// The same pair with the same stamp, 1 to 8 times again.
    RepeatedFrame,
    /// The same pair with stamps that go on, 1 to 8 times, while the scene moves on: a frozen camera.
    FrozenFrame,
    /// New pairs with the stamp of the one before, 1 to 5 of them.
    RepeatedStamp,
    /// A stamp of 0 or the largest number for 1 to 3 frames, or a jump by 10⁹ s there or back.
    Extreme,
    /// The scene changes, after a gap of 1.5 to 60 s.
    SceneChange,
}

impl TimeFault {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::Gap,
        Self::JumpForward,
        Self::JumpBack,
        Self::RepeatedFrame,
        Self::FrozenFrame,
        Self::RepeatedStamp,
        Self::Extreme,
        Self::SceneChange,
    ];

    /// Those that are drawn within a scene, each as often as it stands here; extremes are seldom.
    const DRAWN: [Self; 16] = [
        Self::Gap,
        Self::Gap,
        Self::Gap,
        Self::Gap,
        Self::Gap,
        Self::JumpForward,
        Self::JumpForward,
        Self::JumpForward,
        Self::JumpBack,
        Self::JumpBack,
        Self::RepeatedFrame,
        Self::RepeatedFrame,
        Self::FrozenFrame,
        Self::RepeatedStamp,
        Self::RepeatedStamp,
        Self::Extreme,
    ];

    /// Name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gap => "gap",
            Self::JumpForward => "jump forward",
            Self::JumpBack => "jump back",
            Self::RepeatedFrame => "repeated frame",
            Self::FrozenFrame => "frozen frame",
            Self::RepeatedStamp => "repeated stamp",
            Self::Extreme => "extreme stamp",
            Self::SceneChange => "scene change",
        }
    }
}

/// A frame as the faulty source shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShownFrame {
    /// Number of the frame in its scene.
    pub index: u64,
    /// Its stamp, in ns.
    pub source_ns: u64,
    /// The fault that begins with it.
    pub fault: Option<TimeFault>,
    /// Whether its image and its stamp are as they should be, one period after those of the frame before.
    pub is_normal: bool,
}

/// Mean number of normal frames from fault to fault: two seconds at 12.5 frames/s, so that obstacles are tracked, and
/// alarms raised, between most of them.
const MEAN_FRAMES: f64 = 25.0;

/// Gaps and jumps, shortest and longest, in seconds.
const GAP_S: (f64, f64) = (0.2, 60.0);
const BACK_S: (f64, f64) = (0.001, 60.0);
/// Gap between two scenes: longer than any filter bridges, as a camera cannot change its place faster.
const CHANGE_S: (f64, f64) = (1.5, 60.0);

/// The longest jump, 10⁹ s, in ns.
const EXTREME_NS: u64 = 1_000_000_000_000_000_000;

/// Stamps beyond this are followed by a jump back by [`EXTREME_NS`], so that the clock does not saturate for good.
const LATE_NS: u64 = 12 * EXTREME_NS;

/// A clock with random faults. The same seed gives the same faults.
#[derive(Clone, Debug)]
pub struct FaultyClock {
    random: fastrand::Rng,
    /// Stamp of the next normal frame, in ns.
    now_ns: u64,
    /// Normal frames until the next fault.
    countdown: u64,
    /// How far the last gap extends beyond the end of the last scene, in ns; `None` before the first scene.
    left_ns: Option<u64>,
}

impl FaultyClock {
    /// A clock that starts at 0.
    pub fn new(seed: u64) -> Self {
        let mut clock =
            Self { random: fastrand::Rng::with_seed(seed), now_ns: 0, countdown: 0, left_ns: None };
        clock.countdown = clock.draw_countdown();
        clock
    }

    /// A number from `0` up to below `count`, for choices beside the faults.
    pub fn choose(&mut self, count: usize) -> usize {
        self.random.usize(0..count.max(1))
    }

    fn draw_countdown(&mut self) -> u64 {
        (-MEAN_FRAMES * (1.0 - self.random.f64()).ln()).ceil().max(1.0) as u64
    }

    /// A time between two limits, in ns: each order of magnitude is equally likely.
    fn draw_ns(&mut self, (low_s, high_s): (f64, f64)) -> u64 {
        (1e9 * low_s * (high_s / low_s).powf(self.random.f64())) as u64
    }

    /// What the source shows of a scene of `frames` frames. Returns the frames and the true time that passes, in ns,
    /// with the gap before the scene.
    pub fn scene(&mut self, frames: u64, period_ns: u64) -> (Vec<ShownFrame>, u64) {
        let mut shown = Vec::new();
        let mut fault = None;
        let mut passed_ns = 0;
        if let Some(left_ns) = self.left_ns.take() {
            let gap_ns = self.draw_ns(CHANGE_S);
            self.now_ns = self.now_ns.saturating_add(gap_ns);
            passed_ns += left_ns + gap_ns;
            fault = Some(TimeFault::SceneChange);
        }
        let mut index = 0;
        while index < frames {
            let is_normal = fault.is_none();
            let frame = ShownFrame { index, source_ns: self.now_ns, fault: fault.take(), is_normal };
            shown.push(frame);
            self.countdown -= 1;
            self.now_ns = self.now_ns.saturating_add(period_ns);
            index += 1;
            if self.countdown == 0 {
                self.countdown = self.draw_countdown();
                let kind = if self.now_ns > LATE_NS {
                    TimeFault::Extreme
                } else {
                    TimeFault::DRAWN[self.random.usize(0..TimeFault::DRAWN.len())]
                };
                fault = self.inject(kind, frame, period_ns, frames, &mut index, &mut shown);
            }
        }
        self.left_ns = Some((index - frames) * period_ns);
        (shown, passed_ns + frames * period_ns)
    }

    /// Applies a fault after the frame `last`. Returns the fault if the next normal frame begins it; the frames of all
    /// others are appended.
    fn inject(
        &mut self,
        kind: TimeFault,
        last: ShownFrame,
        period_ns: u64,
        frames: u64,
        index: &mut u64,
        shown: &mut Vec<ShownFrame>,
    ) -> Option<TimeFault> {
        match kind {
            TimeFault::Gap | TimeFault::SceneChange => {
                let missing = self.draw_ns(GAP_S).div_ceil(period_ns);
                *index += missing;
                self.now_ns = self.now_ns.saturating_add(missing * period_ns);
                Some(TimeFault::Gap)
            }
            TimeFault::JumpForward => {
                self.now_ns = self.now_ns.saturating_add(self.draw_ns(GAP_S));
                Some(kind)
            }
            TimeFault::JumpBack => {
                let back_ns = self.draw_ns(BACK_S) + period_ns;
                self.now_ns = self.now_ns.saturating_sub(back_ns);
                Some(kind)
            }
            TimeFault::RepeatedFrame => {
                for k in 0..self.random.u64(1..=8) {
                    shown.push(ShownFrame { fault: (k == 0).then_some(kind), is_normal: false, ..last });
                }
                None
            }
            TimeFault::FrozenFrame => {
                for k in 0..self.random.u64(1..=8) {
                    let fault = (k == 0).then_some(kind);
                    shown.push(ShownFrame { source_ns: self.now_ns, fault, is_normal: false, ..last });
                    self.now_ns = self.now_ns.saturating_add(period_ns);
                    *index += 1;
                }
                None
            }
            TimeFault::RepeatedStamp => {
                for k in 0..self.random.u64(1..=5) {
                    if *index < frames {
                        let fault = (k == 0).then_some(kind);
                        shown.push(ShownFrame { index: *index, fault, is_normal: false, ..last });
                    }
                    *index += 1;
                    self.now_ns = self.now_ns.saturating_add(period_ns);
                }
                None
            }
            TimeFault::Extreme => self.extreme(period_ns, frames, index, shown),
        }
    }

    fn extreme(
        &mut self,
        period_ns: u64,
        frames: u64,
        index: &mut u64,
        shown: &mut Vec<ShownFrame>,
    ) -> Option<TimeFault> {
        let choice = if self.now_ns > LATE_NS { 1 } else { self.random.usize(0..4) };
        match choice {
            0 => self.now_ns = self.now_ns.saturating_add(EXTREME_NS),
            1 => self.now_ns = self.now_ns.saturating_sub(EXTREME_NS),
            _ => {
                let source_ns = if choice == 2 { 0 } else { u64::MAX };
                for k in 0..self.random.u64(1..=3) {
                    if *index < frames {
                        let fault = (k == 0).then_some(TimeFault::Extreme);
                        shown.push(ShownFrame { index: *index, source_ns, fault, is_normal: false });
                    }
                    *index += 1;
                    self.now_ns = self.now_ns.saturating_add(period_ns);
                }
                return None;
            }
        }
        Some(TimeFault::Extreme)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 80_000_000;

    #[test]
    fn all_faults_occur_and_the_same_seed_gives_the_same() {
        let play = |seed| {
            let mut clock = FaultyClock::new(seed);
            (0..200).map(|_| clock.scene(100, PERIOD_NS)).collect::<Vec<_>>()
        };
        let scenes = play(3);
        assert_eq!(scenes, play(3));
        assert_ne!(scenes, play(4));
        let shown: Vec<&ShownFrame> = scenes.iter().flat_map(|(shown, _)| shown).collect();
        for kind in TimeFault::ALL {
            let count = shown.iter().filter(|frame| frame.fault == Some(kind)).count();
            assert!(count >= 10, "{}: {count}", kind.name());
        }
        assert!(shown.iter().all(|frame| frame.index < 100));
        let normal = shown.iter().filter(|frame| frame.is_normal).count();
        assert!(2 * normal > shown.len(), "{normal} of {}", shown.len());
        // Time goes by as fast as the scenes, plus the gaps between them.
        assert!(scenes.iter().all(|(_, passed_ns)| *passed_ns >= 100 * PERIOD_NS));
        assert!(scenes[1..].iter().all(|(_, passed_ns)| *passed_ns > 100 * PERIOD_NS + 1_500_000_000));
    }

    #[test]
    fn normal_frames_are_one_period_apart() {
        let mut clock = FaultyClock::new(7);
        for _ in 0..50 {
            let (shown, _) = clock.scene(100, PERIOD_NS);
            for pair in shown.windows(2).filter(|pair| pair[1].is_normal && pair[0].is_normal) {
                assert_eq!(pair[1].index, pair[0].index + 1, "{pair:?}");
                assert_eq!(pair[1].source_ns, pair[0].source_ns.saturating_add(PERIOD_NS), "{pair:?}");
            }
        }
    }
}
