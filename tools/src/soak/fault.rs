//! Fault injection: the kinds of faults and how they are drawn.

use serde::Serialize;
use std::fmt;

/// Duration of high temperature: the thermal ladder must react within it.
const HEAT_NS: u64 = 3_000_000_000;

/// Names of the stages, in pipeline order.
pub type StageNames = &'static [&'static str];

/// Kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultKind {
    /// SIGKILL: the stage terminates immediately.
    Kill,
    /// SIGTERM not sent by the scheduler: the stage exits on its own.
    Exit,
    /// Permanent SIGSTOP: the daemon has to detect the hang, kill and restart the stage. For capture it acts like a
    /// source that never returns.
    Hang,
    /// SIGSTOP shorter than the liveness deadline: the daemon has to tolerate it. For capture it acts like a source
    /// that stalls.
    Stall,
    /// The (simulated) board gets so hot that the stages must pause, and cools down again.
    Heat,
}

impl FaultKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Kill, Self::Exit, Self::Hang, Self::Stall, Self::Heat];

    /// Whether the daemon must restart the stage, exactly once.
    pub fn restarts(self) -> bool {
        !matches!(self, Self::Stall | Self::Heat)
    }

    /// Name of the kind.
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

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Kind.
    pub kind: FaultKind,
    /// Affected stage; for heat the first one, which stops delivering pairs.
    pub stage: usize,
    /// Its name.
    pub stage_name: &'static str,
    /// Duration of a stall or of heat, in nanoseconds.
    pub stall_ns: u64,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}", self.kind.name(), self.place())
    }
}

impl Fault {
    /// Name of the affected component.
    pub fn place(&self) -> &'static str {
        match self.kind {
            FaultKind::Heat => "the board",
            _ => self.stage_name,
        }
    }
}

/// Distribution of fault kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mix {
    /// SIGKILL only.
    Kills,
    /// Three kills in seven faults; the rest of all other kinds.
    All,
}

impl Mix {
    /// Draws a fault. Stalls last at most 2/5 of the liveness deadline, so that a daemon within its deadlines does
    /// not consider them hangs.
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
