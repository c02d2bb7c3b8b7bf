//! Pairing of frames from two cameras by exposure time.

/// What to do with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Keep it until its partner arrives; the frame held before on its side is dropped.
    Hold,
    /// It forms a pair with the frame held on the other side.
    Pair {
        /// Time between the two exposures, in nanoseconds.
        skew_ns: u64,
    },
    /// Drop it: its partner was lost, or it is out of order.
    Drop,
}

/// Both cameras deliver frames, but for so long no pair came of them, in nanoseconds: they expose at different times. Some
/// frames must be lost one by one without a word.
const UNPAIRED_NS: u64 = 3_000_000_000;

/// Frames of both cameras that found no partner, since the last pair.
#[derive(Clone, Copy, Debug, Default)]
struct Unpaired {
    /// Time of the first, in nanoseconds.
    since_ns: Option<u64>,
    /// Number of each side.
    frames: [u64; 2],
    /// Least time between a frame and the one before it of the other side, in nanoseconds.
    nearest_ns: Option<u64>,
}

/// Counters since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Pairs.
    pub pairs: u64,
    /// Frames without a partner, left and right.
    pub single: [u64; 2],
    /// Frames out of order, left and right.
    pub out_of_order: [u64; 2],
    /// Largest time between the exposures of a pair, in nanoseconds.
    pub worst_skew_ns: u64,
}

/// Matches frames by exposure time. Each side delivers its frames in order; at most one per side is held.
#[derive(Clone, Debug)]
pub struct Pairing {
    bound_ns: u64,
    /// Exposure time of the held frame.
    held: [Option<u64>; 2],
    last: [Option<u64>; 2],
    unpaired: Unpaired,
    counts: Counts,
}

impl Pairing {
    /// Frames whose exposures are at most `bound_ns` apart form a pair. The bound must be less than half the
    /// frame period.
    pub fn new(bound_ns: u64) -> Self {
        Self {
            bound_ns,
            held: [None; 2],
            last: [None; 2],
            unpaired: Unpaired::default(),
            counts: Counts::default(),
        }
    }

    /// Counters since the start.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Whether a side holds a frame.
    pub fn holds(&self, side: usize) -> bool {
        self.held[side].is_some()
    }

    /// A side was lost or restarts: its held frame is dropped, and its clock may differ from now on.
    pub fn reset(&mut self, side: usize) {
        self.counts.single[side] += u64::from(self.held[side].take().is_some());
        self.last[side] = None;
        self.unpaired = Unpaired::default();
    }

    /// The least time between exposures of left and right, in nanoseconds, if both sides have delivered frames for
    /// seconds and none formed a pair.
    pub fn out_of_step(&self) -> Option<u64> {
        let Unpaired { since_ns, frames, nearest_ns } = self.unpaired;
        let newest = self.last.into_iter().flatten().max()?;
        let is_long = newest.saturating_sub(since_ns?) >= UNPAIRED_NS;
        // A side that is lost or slow has a reason of its own.
        let [most, least] = [frames[0].max(frames[1]), frames[0].min(frames[1])];
        nearest_ns.filter(|_| is_long && least > 0 && 2 * least >= most)
    }

    /// Offers a frame of `side` (0 or 1), exposed at `time_ns`.
    pub fn offer(&mut self, side: usize, time_ns: u64) -> Verdict {
        if self.last[side].is_some_and(|last| time_ns <= last) {
            self.counts.out_of_order[side] += 1;
            return Verdict::Drop;
        }
        self.last[side] = Some(time_ns);
        let other = 1 - side;
        let unpaired = &mut self.unpaired;
        unpaired.since_ns.get_or_insert(time_ns);
        unpaired.frames[side] += 1;
        if let Some(of_other) = self.last[other] {
            let apart = of_other.abs_diff(time_ns);
            unpaired.nearest_ns = Some(unpaired.nearest_ns.map_or(apart, |nearest| nearest.min(apart)));
        }
        if let Some(waiting) = self.held[other] {
            let skew_ns = waiting.abs_diff(time_ns);
            if skew_ns <= self.bound_ns {
                self.held[other] = None;
                // The older frame of this side found no partner.
                self.counts.single[side] += u64::from(self.held[side].take().is_some());
                self.counts.pairs += 1;
                self.unpaired = Unpaired::default();
                self.counts.worst_skew_ns = self.counts.worst_skew_ns.max(skew_ns);
                return Verdict::Pair { skew_ns };
            }
            if waiting > time_ns {
                // The partner would have arrived before the held frame.
                self.counts.single[side] += 1;
                return Verdict::Drop;
            }
            // The partner of the held frame would have arrived before this one.
            self.held[other] = None;
            self.counts.single[other] += 1;
        }
        self.counts.single[side] += u64::from(self.held[side].is_some());
        self.held[side] = Some(time_ns);
        Verdict::Hold
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn pairing() -> Pairing {
        Pairing::new(2 * MS)
    }

    #[test]
    fn frames_of_one_time_are_a_pair_whichever_comes_first() {
        let mut p = pairing();
        for n in 1..100 {
            let t = n * 33 * MS;
            let (first, second) = ((n % 2) as usize, (1 - n % 2) as usize);
            assert_eq!(p.offer(first, t), Verdict::Hold);
            assert_eq!(p.offer(second, t + MS), Verdict::Pair { skew_ns: MS });
        }
        assert_eq!(p.counts(), Counts { pairs: 99, worst_skew_ns: MS, ..Counts::default() });
    }

    #[test]
    fn a_dropped_frame_costs_its_partner_and_nothing_else() {
        let mut p = pairing();
        let mut pairs = Vec::new();
        for n in 1..20_u64 {
            // The right camera drops frames 5, 6 and 12.
            let t = n * 33 * MS;
            p.offer(0, t);
            if ![5, 6, 12].contains(&n) && matches!(p.offer(1, t), Verdict::Pair { .. }) {
                pairs.push(n);
            }
        }
        assert_eq!(pairs, (1..20).filter(|n| ![5, 6, 12].contains(n)).collect::<Vec<_>>());
        assert_eq!(p.counts().single, [3, 0]);
    }

    #[test]
    fn frames_too_far_apart_are_no_pair() {
        let mut p = pairing();
        assert_eq!(p.offer(0, 10 * MS), Verdict::Hold);
        assert_eq!(p.offer(1, 15 * MS), Verdict::Hold, "5 ms are more than the bound of 2");
        assert_eq!(p.counts().single, [1, 0]);
        // A late frame whose partner is gone.
        assert_eq!(p.offer(0, 12 * MS), Verdict::Drop);
        assert_eq!(p.offer(0, 16 * MS), Verdict::Pair { skew_ns: MS });
        // Timestamps that go backwards or repeat are rejected.
        assert_eq!(p.offer(0, 16 * MS), Verdict::Drop);
        assert_eq!(p.offer(0, 3 * MS), Verdict::Drop);
        assert_eq!(p.counts().out_of_order, [2, 0]);
        // A restarted camera may have a new clock.
        p.reset(0);
        assert_eq!(p.offer(0, MS), Verdict::Hold);
    }

    #[test]
    fn cameras_that_never_expose_together_are_out_of_step() {
        // Side 1 is 12 ms behind, which is more than the bound of 2.
        let mut p = pairing();
        let mut told = None;
        for n in 1..200_u64 {
            assert!(!matches!(p.offer(0, n * 33 * MS), Verdict::Pair { .. }));
            assert!(!matches!(p.offer(1, n * 33 * MS + 12 * MS), Verdict::Pair { .. }));
            told = told.or(p.out_of_step().map(|nearest| (n, nearest)));
        }
        let (frame, nearest) = told.expect("no pair for 6 s");
        assert!((3000..3100).contains(&(frame * 33)) && nearest == 12 * MS, "{frame}, {nearest}");
        // A pair ends it, and lost frames are nothing of the kind; nor is a side that delivers nothing.
        p.offer(0, 7000 * MS);
        assert!(matches!(p.offer(1, 7001 * MS), Verdict::Pair { .. }) && p.out_of_step().is_none());
        for n in 300..600_u64 {
            p.offer(0, n * 33 * MS);
        }
        assert_eq!(p.out_of_step(), None);
    }

    #[test]
    fn with_jitter_losses_and_delays_no_wrong_pair_is_made() {
        let seed = 7;
        println!("seed {seed}");
        let mut random = fastrand::Rng::with_seed(seed);
        for _ in 0..200 {
            let mut p = pairing();
            // Exposure and arrival of each frame; both cameras are triggered together.
            let mut arrivals: Vec<(u64, usize, u64, u64)> = Vec::new();
            let mut whole = 0;
            for n in 1..200_u64 {
                let mut both = 0;
                for side in 0..2 {
                    if random.f32() < 0.9 {
                        let exposed = n * 33 * MS + random.u64(0..MS);
                        // Transport takes up to 30 ms, but frames stay in order.
                        arrivals.push((exposed + random.u64(0..30 * MS), side, exposed, n));
                        both += 1;
                    }
                }
                whole += u64::from(both == 2);
            }
            arrivals.sort();
            let mut held = [0; 2];
            for (_, side, exposed, n) in arrivals {
                match p.offer(side, exposed) {
                    Verdict::Hold => held[side] = n,
                    Verdict::Pair { .. } => assert_eq!(held[1 - side], n, "frames of different times"),
                    Verdict::Drop => {}
                }
            }
            let counts = p.counts();
            assert_eq!(counts.pairs, whole, "every complete pair is found");
            assert!(counts.worst_skew_ns <= 2 * MS);
        }
    }
}
