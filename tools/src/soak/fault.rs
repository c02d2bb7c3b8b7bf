//! What is done to the daemon while it runs.

use serde::Serialize;
use std::fmt;

/// How long the board is hot: the ladder must have answered by then.
const HEAT_NS: u64 = 3_000_000_000;

/// Names of the stages that faults are made of, in the order of their numbers here.
pub type StageNames = &'static [&'static str];

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultKind {
    /// SIGKILL: the stage is gone at once.
    Kill,
    /// SIGTERM that the scheduler did not send: the stage ends by itself.
    Exit,
    /// SIGSTOP for good: the daemon has to notice, kill and restart. Of capture it is a source that
    /// never comes back.
    Hang,
    /// SIGSTOP for less than the liveness deadline: the daemon has to sit it out. Of capture it is a
    /// source that stalls.
    Stall,
    /// The board (one made up for the soak) gets so hot that the stages must wait, and cools down again.
    Heat,
}

impl FaultKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Kill, Self::Exit, Self::Hang, Self::Stall, Self::Heat];

    /// Whether the daemon must restart the stage, once.
    pub fn restarts(self) -> bool {
        !matches!(self, Self::Stall | Self::Heat)
    }

    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kill => "kill",
            Self::Exit => "exit",
            Self::Hang => "hang",
            Self::Stall => "stall",
            Self::Heat => "heat",
        }
    }
}

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What is done.
    pub kind: FaultKind,
    /// To which stage; heat holds up the first, which brings no pairs then.
    pub stage: usize,
    /// Its name.
    pub stage_name: &'static str,
    /// How long a stall or the heat lasts.
    pub stall_ns: u64,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}", self.kind.name(), self.place())
    }
}

impl Fault {
    /// The name of what the fault is done to.
    pub fn place(&self) -> &'static str {
        match self.kind {
            FaultKind::Heat => "the board",
            _ => self.stage_name,
        }
    }
}

/// Which faults are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mix {
    /// SIGKILL alone.
    Kills,
    /// Three in seven kills, the rest of all other kinds.
    All,
}

impl Mix {
    /// Draws a fault. Stalls are at most two fifths of the liveness deadline long, so that a daemon
    /// that keeps its deadline does not take them for hangs.
    pub fn draw(self, random: &mut fastrand::Rng, liveness_ns: u64, stages: StageNames) -> Fault {
        let kind = match (self, random.u8(0..7)) {
            (Self::Kills, _) | (Self::All, 0..=2) => FaultKind::Kill,
            (Self::All, 3) => FaultKind::Exit,
            (Self::All, 4) => FaultKind::Hang,
            (Self::All, 5) => FaultKind::Stall,
            (Self::All, _) => FaultKind::Heat,
        };
        let longest_ns = (liveness_ns / 5 * 2).max(2);
        let (stage, stall_ns) = (random.usize(0..stages.len()), random.u64(longest_ns / 4..longest_ns));
        let (stage, stall_ns) = if kind == FaultKind::Heat { (0, HEAT_NS) } else { (stage, stall_ns) };
        Fault { kind, stage, stage_name: stages[stage], stall_ns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: StageNames = &["capture", "stereo", "road", "recognition"];

    #[test]
    fn the_same_seed_draws_the_same_faults_and_all_come() {
        let draw = |mix: Mix, seed| {
            let mut random = fastrand::Rng::with_seed(seed);
            (0..400).map(|_| mix.draw(&mut random, 1_000_000_000, STAGES)).collect::<Vec<_>>()
        };
        assert_eq!(draw(Mix::All, 3), draw(Mix::All, 3));
        assert_ne!(draw(Mix::All, 3), draw(Mix::All, 4));
        let all = draw(Mix::All, 3);
        for stage in 0..STAGES.len() {
            for kind in FaultKind::ALL {
                let comes = all.iter().any(|f| f.kind == kind && f.stage == stage);
                assert_eq!(comes, kind != FaultKind::Heat || stage == 0, "{kind:?} {stage}");
            }
        }
        let short = |f: &Fault| (100_000_000..400_000_000).contains(&f.stall_ns);
        assert!(all.iter().all(|f| short(f) || f.kind == FaultKind::Heat));
        assert!(draw(Mix::Kills, 3).iter().all(|f| f.kind == FaultKind::Kill));
        assert_eq!(all[0].to_string().split(" of ").count(), 2);
    }
}
