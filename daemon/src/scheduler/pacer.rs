//! Rate control of the source: a pure state machine. Time is passed in.
//!
//! The period between two pairs follows the slowest stage by the 90th percentile of its work, plus headroom. It grows
//! at once, because frames would be overtaken otherwise, and shrinks in small steps with pauses, so that a stage with
//! varying times does not make the rate oscillate. It is never shorter than the configured period (that of the source,
//! or `source.fps`) and stays within the bounds.

use messages::pipeline::Role;

/// Number of recent frames of each stage that are evaluated.
const WINDOW: usize = 64;
/// Minimum number of finished frames before a stage counts.
const MIN_FRAMES: usize = 8;
/// Time between two evaluations, in nanoseconds.
const EVALUATION_NS: u64 = 1_000_000_000;
/// Smaller relative changes of the period are ignored.
const DEAD_BAND: f64 = 0.02;
/// Maximum relative increase of the rate in one step.
const RISE: f64 = 0.10;
/// Minimum time between two increases of the rate, in nanoseconds.
const RISE_PAUSE_NS: u64 = 3_000_000_000;

/// Parameters of the pacer; times in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PacerParameters {
    /// Whether the rate follows the stages.
    pub follow: bool,
    /// Configured time between pairs.
    pub wanted_ns: u64,
    /// Minimum time between pairs: 1 / `max_fps`.
    pub shortest_ns: u64,
    /// Maximum time between pairs: 1 / `min_fps`.
    pub longest_ns: u64,
    /// Headroom, as a share of the slowest stage's time.
    pub headroom: f64,
}

/// The most recent times of one stage.
#[derive(Clone, Debug)]
struct Window {
    times_ns: [u64; WINDOW],
    count: usize,
}

impl Window {
    fn add(&mut self, ns: u64) {
        self.times_ns[self.count % WINDOW] = ns;
        self.count += 1;
    }

    fn p90_ns(&self) -> Option<u64> {
        if self.count < MIN_FRAMES {
            return None;
        }
        let mut times = self.times_ns;
        let times = &mut times[..self.count.min(WINDOW)];
        let place = (times.len() * 9).div_ceil(10) - 1;
        Some(*times.select_nth_unstable(place).1)
    }
}

/// The rate control.
#[derive(Clone, Debug)]
pub struct Pacer {
    parameters: PacerParameters,
    windows: [Window; Role::STAGES.len()],
    period_ns: u64,
    evaluated_ns: u64,
    changed_ns: u64,
}

impl Pacer {
    /// Starts with the configured period, within the bounds.
    pub fn new(parameters: PacerParameters, now_ns: u64) -> Self {
        let window = || Window { times_ns: [0; WINDOW], count: 0 };
        let mut pacer = Self {
            parameters,
            windows: std::array::from_fn(|_| window()),
            period_ns: parameters.wanted_ns,
            evaluated_ns: now_ns,
            changed_ns: now_ns,
        };
        if parameters.follow {
            pacer.period_ns = pacer.bounded(0);
        }
        pacer
    }

    /// Time between pairs, in nanoseconds.
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// The parameters.
    pub fn parameters(&self) -> PacerParameters {
        self.parameters
    }

    /// Adds the work of a stage on a frame, in nanoseconds.
    pub fn work(&mut self, role: Role, work_ns: u64) {
        if let Some(place) = Role::STAGES.iter().position(|r| *r == role) {
            self.windows[place].add(work_ns);
        }
    }

    /// The slowest stage by the 90th percentile of its work, and this percentile in nanoseconds.
    pub fn slowest(&self) -> Option<(Role, u64)> {
        let times = Role::STAGES.into_iter().zip(&self.windows).filter_map(|(r, w)| Some((r, w.p90_ns()?)));
        times.max_by_key(|(_, ns)| *ns)
    }

    /// Limits a period: not shorter than the configured one, and within the bounds as far as that allows.
    fn bounded(&self, ns: u64) -> u64 {
        let p = &self.parameters;
        let shortest = p.wanted_ns.max(p.shortest_ns);
        ns.clamp(shortest, p.longest_ns.max(shortest))
    }

    /// Evaluates the times if that is due; has to be called often. Returns the period if it has changed.
    pub fn tick(&mut self, now_ns: u64) -> Option<u64> {
        if !self.parameters.follow || now_ns.saturating_sub(self.evaluated_ns) < EVALUATION_NS {
            return None;
        }
        self.evaluated_ns = now_ns;
        let (_, slowest_ns) = self.slowest()?;
        let target = self.bounded((slowest_ns as f64 * (1.0 + self.parameters.headroom)) as u64);
        let (before, wanted) = (self.period_ns as f64, target as f64);
        let period_ns = if wanted > before * (1.0 + DEAD_BAND) {
            target
        } else if wanted < before * (1.0 - DEAD_BAND)
            && now_ns.saturating_sub(self.changed_ns) >= RISE_PAUSE_NS
        {
            target.max((before / (1.0 + RISE)) as u64)
        } else {
            return None;
        };
        self.period_ns = period_ns;
        self.changed_ns = now_ns;
        Some(period_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const S: u64 = 1_000_000_000;

    fn parameters(wanted_hz: f64) -> PacerParameters {
        PacerParameters {
            follow: true,
            wanted_ns: (1e9 / wanted_hz) as u64,
            shortest_ns: S / 30,
            longest_ns: S / 5,
            headroom: 0.05,
        }
    }

    /// Result of a simulated pipeline that takes the newest pair when it is free.
    struct Outcome {
        processed_hz: f64,
        dropped: u32,
        changes: u32,
    }

    /// Simulates `seconds` of a pipeline whose slowest stage takes `stage_ms` of the time. The result covers the second
    /// half, when the rate has settled.
    fn simulate(pacer: &mut Pacer, seconds: u64, mut stage_ms: impl FnMut(u64) -> f64) -> Outcome {
        let (mut now, mut free_at, mut busy_with) = (0_u64, 0_u64, None::<u64>);
        let mut waiting = false;
        let mut outcome = Outcome { processed_hz: 0.0, dropped: 0, changes: 0 };
        let mut processed = 0;
        while now < seconds * S {
            let counts = now >= seconds * S / 2;
            // A new pair overtakes one that is still waiting.
            outcome.dropped += u32::from(waiting && counts);
            waiting = true;
            let next = now + pacer.period_ns();
            while waiting && free_at <= next {
                if let Some(work) = busy_with.take() {
                    pacer.work(Role::Stereo, work);
                    pacer.work(Role::Road, 9 * MS);
                    processed += u32::from(counts);
                }
                waiting = false;
                let work = (stage_ms(now) * MS as f64) as u64;
                free_at = free_at.max(now) + work;
                busy_with = Some(work);
            }
            now = next;
            outcome.changes += u32::from(pacer.tick(now).is_some() && counts);
        }
        outcome.processed_hz = f64::from(processed) / (seconds as f64 / 2.0);
        outcome
    }

    #[test]
    fn the_rates_of_the_paper_are_reached_without_dropping_frames() {
        // The paper's system sustains 13.1 to 13.5 frames a second: about 72 ms in the slowest stage.
        let mut random = fastrand::Rng::with_seed(11);
        for (offered_hz, paper_hz) in [(10.0, 9.7), (15.0, 12.9), (20.0, 12.9)] {
            let mut pacer = Pacer::new(parameters(offered_hz), 0);
            let outcome = simulate(&mut pacer, 120, |_| 70.0 + 4.0 * random.f64());
            assert!(
                outcome.processed_hz >= paper_hz && outcome.processed_hz <= 13.5,
                "{offered_hz} offered: {} processed, the paper has {paper_hz}",
                outcome.processed_hz
            );
            assert_eq!(outcome.dropped, 0, "{offered_hz} offered");
        }
        // Without pacing, frames beyond the capacity are overtaken.
        let mut free = Pacer::new(PacerParameters { follow: false, ..parameters(20.0) }, 0);
        let outcome = simulate(&mut free, 120, |_| 72.0);
        assert!(outcome.dropped > 300, "{}", outcome.dropped);
    }

    #[test]
    fn the_rate_falls_at_once_and_rises_in_steps() {
        let mut pacer = Pacer::new(parameters(20.0), 0);
        assert_eq!(pacer.period_ns(), 50 * MS);
        let feed = |pacer: &mut Pacer, ms: u64| (0..WINDOW).for_each(|_| pacer.work(Role::Stereo, ms * MS));
        feed(&mut pacer, 100);
        assert_eq!(pacer.tick(S / 2), None, "before the next evaluation");
        assert_eq!(pacer.tick(S), Some(105 * MS));
        feed(&mut pacer, 20);
        assert_eq!(pacer.tick(2 * S), None, "within the pause");
        let mut periods = Vec::new();
        for second in 3..60 {
            periods.extend(pacer.tick(second * S));
        }
        assert_eq!(periods.last(), Some(&(50 * MS)), "never faster than configured: {periods:?}");
        assert!(periods.len() >= 7 && periods.windows(2).all(|w| w[1] < w[0]), "{periods:?}");
        assert!(periods.windows(2).all(|w| (w[0] as f64) < w[1] as f64 * 1.11), "{periods:?}");
    }

    #[test]
    fn bounds_hold_and_a_slower_source_keeps_its_rate() {
        let mut pacer = Pacer::new(parameters(100.0), 0);
        assert_eq!(pacer.period_ns(), S / 30, "max_fps");
        (0..WINDOW).for_each(|_| pacer.work(Role::Road, 900 * MS));
        assert_eq!(pacer.tick(S), Some(S / 5), "min_fps: frames are overtaken then");
        assert_eq!(pacer.slowest(), Some((Role::Road, 900 * MS)));
        let mut slow = Pacer::new(parameters(1.0), 0);
        (0..WINDOW).for_each(|_| slow.work(Role::Road, 2 * MS));
        assert_eq!((slow.tick(S), slow.period_ns()), (None, S));
        // The writer does not count.
        (0..WINDOW).for_each(|_| slow.work(Role::Writer, 2000 * MS));
        assert_eq!(slow.slowest(), Some((Role::Road, 2 * MS)));
    }

    #[test]
    fn random_variation_does_not_make_the_rate_oscillate() {
        for seed in 0..50 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut pacer = Pacer::new(parameters(20.0), 0);
            // One of 16 frames takes 1.5 times as long.
            let outcome = simulate(&mut pacer, 300, |_| {
                let base = 60.0 + 3.0 * random.f64();
                if random.u8(..16) == 0 { 1.5 * base } else { base }
            });
            assert!(outcome.changes <= 75, "seed {seed}: {} changes in 150 s", outcome.changes);
        }
    }
}
