//! Schedule of fault injection: a pure state machine; the caller passes the time.
//!
//! ```text
//!        pause over, results flow          signal sent                  next result of the restarted stage
//! Calm ───────────────────────────▶ Asked ────────────▶ Recovering ───────────────────────────────────────▶ Calm
//!                                     │ a stall is over      ▲ │ patience ends: counted as failed, waits on
//!                                     └──▶ Stalled ──────────┘
//! ```
//!
//! Heat is modelled as a stall of the whole daemon, caused by its thermal ladder.

use super::fault::{Fault, FaultKind, Mix, StageNames};
use super::recovery::Recoveries;

/// A result counts as recovery only if captured this long after the signal: a frame may have been in flight
/// during its delivery.
const SIGNAL_NS: u64 = 2_000_000;

/// Parameters of fault injection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectorParameters {
    /// Mix of fault kinds.
    pub mix: Mix,
    /// Names of the stages.
    pub stages: StageNames,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Mean pause from a recovery to the next fault, in nanoseconds; drawn uniformly from 0.5 to 1.5 times this
    /// value.
    pub pause_ns: u64,
    /// Time after which the daemon considers a silent stage hung.
    pub liveness_ns: u64,
    /// Time limit of a recovery.
    pub patience_ns: u64,
    /// Number of SIGKILLs after which injection ends.
    pub kills: Option<u64>,
}

/// Action on a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// SIGKILL.
    Kill,
    /// SIGTERM.
    Terminate,
    /// SIGSTOP.
    Stop,
    /// SIGCONT.
    Continue,
    /// No signal: raises the simulated temperature to where the stages must pause.
    Heat,
    /// Lowers the temperature again.
    Cool,
}

/// An action on a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// Index of the stage.
    pub stage: usize,
    /// Action.
    pub signal: Signal,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Calm { next_ns: u64 },
    Asked { fault: Fault },
    Stalled { fault: Fault, from_ns: u64, until_ns: u64 },
    Recovering { fault: Fault, from_ns: u64, since_ns: u64, restarted: bool, failed: bool },
}

/// Injects faults one at a time, and waits for the recovery from each.
#[derive(Clone, Debug)]
pub struct Director {
    parameters: DirectorParameters,
    random: fastrand::Rng,
    state: State,
    start_ns: u64,
    /// Whether the daemon has reacted to the heat.
    held_up: bool,
    ends: bool,
    /// Recovery statistics.
    pub recoveries: Recoveries,
}

/// A fault after its recovery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Time of the fault.
    pub from_ns: u64,
    /// Time of the first result after it.
    pub result_ns: u64,
}

impl Director {
    /// A director whose first fault follows after a pause.
    pub fn new(parameters: DirectorParameters, now_ns: u64) -> Self {
        let mut random = fastrand::Rng::with_seed(parameters.seed);
        let next_ns = now_ns + pause(&mut random, parameters.pause_ns);
        Self {
            parameters,
            random,
            state: State::Calm { next_ns },
            start_ns: now_ns,
            held_up: false,
            ends: false,
            recoveries: Recoveries::default(),
        }
    }

    /// The action due now, if any; `steady` means that all stages run and results arrive.
    pub fn tick(&mut self, now_ns: u64, steady: bool) -> Option<Order> {
        match self.state {
            State::Calm { next_ns } if now_ns >= next_ns && steady && !self.is_over() => {
                let fault = self.parameters.mix.draw(
                    &mut self.random,
                    self.parameters.liveness_ns,
                    self.parameters.stages,
                );
                self.state = State::Asked { fault };
                let signal = match fault.kind {
                    FaultKind::Kill => Signal::Kill,
                    FaultKind::Exit => Signal::Terminate,
                    FaultKind::Hang | FaultKind::Stall => Signal::Stop,
                    FaultKind::Heat => Signal::Heat,
                };
                Some(Order { stage: fault.stage, signal })
            }
            State::Stalled { fault, from_ns, until_ns } if now_ns >= until_ns => {
                let is_heat = fault.kind == FaultKind::Heat;
                let failed = is_heat && !self.held_up;
                if failed {
                    self.recoveries.failed(&fault);
                }
                self.state = State::Recovering { fault, from_ns, since_ns: now_ns, restarted: true, failed };
                Some(Order {
                    stage: fault.stage,
                    signal: if is_heat { Signal::Cool } else { Signal::Continue },
                })
            }
            State::Recovering { fault, from_ns, since_ns, restarted, failed: false }
                if now_ns.saturating_sub(since_ns) > self.parameters.patience_ns =>
            {
                self.recoveries.failed(&fault);
                self.state = State::Recovering { fault, from_ns, since_ns, restarted, failed: true };
                None
            }
            _ => None,
        }
    }

    /// The first signal of a fault was sent; `sent_ns` is the time after sending.
    pub fn sent(&mut self, sent_ns: u64) {
        if let State::Asked { fault } = self.state {
            self.recoveries.made(&fault);
            self.held_up = false;
            self.state = match fault.kind {
                FaultKind::Stall | FaultKind::Heat => {
                    State::Stalled { fault, from_ns: sent_ns, until_ns: sent_ns + fault.stall_ns }
                }
                _ => State::Recovering {
                    fault,
                    from_ns: sent_ns,
                    since_ns: sent_ns,
                    restarted: false,
                    failed: false,
                },
            };
        }
    }

    /// The signal could not be sent, as the stage did not exist.
    pub fn not_sent(&mut self, now_ns: u64) {
        if matches!(self.state, State::Asked { .. }) {
            self.calm(now_ns);
        }
    }

    /// The daemon reports that it paused its stages because of heat. Without this report the fault counts as failed.
    pub fn held_up(&mut self) {
        self.held_up = true;
    }

    /// A stage has a new process that reports.
    pub fn restarted(&mut self, stage: usize) {
        if let State::Recovering { fault, restarted, .. } = &mut self.state
            && fault.stage == stage
        {
            *restarted = true;
        }
    }

    /// A result arrived.
    pub fn result(&mut self, capture_ns: u64, end_ns: u64) -> Option<Recovered> {
        let State::Recovering { fault, from_ns, since_ns, restarted: true, failed } = self.state else {
            return None;
        };
        if capture_ns <= from_ns + SIGNAL_NS || end_ns <= since_ns {
            return None;
        }
        if !failed {
            let at_s = end_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
            self.recoveries.recovered(&fault, at_s, end_ns - since_ns);
        }
        self.calm(end_ns);
        Some(Recovered { from_ns, result_ns: end_ns })
    }

    fn calm(&mut self, now_ns: u64) {
        let next_ns = now_ns + pause(&mut self.random, self.parameters.pause_ns);
        self.state = State::Calm { next_ns };
    }

    /// Time of the fault whose recovery is pending.
    pub fn open_since_ns(&self) -> Option<u64> {
        match self.state {
            State::Stalled { from_ns, .. } | State::Recovering { from_ns, .. } => Some(from_ns),
            State::Calm { .. } | State::Asked { .. } => None,
        }
    }

    /// Ends injection.
    pub fn end(&mut self) {
        self.ends = true;
    }

    fn is_over(&self) -> bool {
        self.ends || self.parameters.kills.is_some_and(|kills| self.recoveries.kills() >= kills)
    }

    /// Whether injection has ended and the last fault is recovered from or given up.
    pub fn is_done(&self) -> bool {
        let at_rest = matches!(self.state, State::Calm { .. } | State::Recovering { failed: true, .. });
        self.is_over() && at_rest
    }
}

fn pause(random: &mut fastrand::Rng, mean_ns: u64) -> u64 {
    random.u64(mean_ns / 2..=mean_ns / 2 * 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const PARAMETERS: DirectorParameters = DirectorParameters {
        mix: Mix::Kills,
        stages: &["capture", "stereo", "road", "recognition"],
        seed: 5,
        pause_ns: 100 * MS,
        liveness_ns: 1000 * MS,
        patience_ns: 30_000 * MS,
        kills: Some(2),
    };

    /// Ticks until an action is due.
    fn order(director: &mut Director, now: &mut u64) -> Order {
        for _ in 0..1000 {
            *now += 10 * MS;
            if let Some(order) = director.tick(*now, true) {
                return order;
            }
        }
        panic!("no action was due");
    }

    #[test]
    fn a_kill_waits_for_a_frame_captured_after_it_through_the_new_process() {
        let mut now = 0;
        let mut director = Director::new(PARAMETERS, now);
        assert_eq!(director.tick(10_000 * MS, false), None, "only while results flow");
        let first = order(&mut director, &mut now);
        assert_eq!(first.signal, Signal::Kill);
        assert!(now >= 50 * MS, "after its pause");
        director.sent(now);
        let killed = now;
        assert_eq!(director.open_since_ns(), Some(killed));
        // In flight at the time of the fault, or captured while the signal was being delivered.
        assert_eq!(director.result(killed - MS, killed + 20 * MS), None);
        director.restarted(first.stage);
        assert_eq!(director.result(killed + MS, killed + 30 * MS), None);
        assert_eq!(director.tick(killed + 500 * MS, true), None, "one fault at a time");
        let recovered = director.result(killed + 600 * MS, killed + 640 * MS).unwrap();
        assert_eq!(recovered, Recovered { from_ns: killed, result_ns: killed + 640 * MS });
        assert!((director.recoveries.longest_s() - 0.64).abs() < 1e-9);
        now = recovered.result_ns;
        let second = order(&mut director, &mut now);
        director.sent(now);
        // The restart of another stage is no recovery.
        director.restarted((second.stage + 1) % 4);
        assert_eq!(director.result(now + 600 * MS, now + 700 * MS), None);
        assert!(!director.is_done());
        director.restarted(second.stage);
        assert!(director.result(now + 800 * MS, now + 900 * MS).is_some());
        assert!(director.is_done());
        assert_eq!(director.tick(now + 100_000 * MS, true), None, "both kills are made");
        assert_eq!((director.recoveries.kills(), director.recoveries.failures()), (2, 0));
    }

    #[test]
    fn a_recovery_that_never_comes_is_counted_once_and_waited_on() {
        let mut now = 0;
        let mut director = Director::new(PARAMETERS, now);
        let first = order(&mut director, &mut now);
        director.sent(now);
        for second in 1..100 {
            assert_eq!(director.tick(now + second * 1000 * MS, false), None);
        }
        assert_eq!(director.recoveries.failures(), 1);
        assert!(!director.is_done(), "one kill is still to be made");
        director.restarted(first.stage);
        assert!(director.result(now + 200_000 * MS, now + 200_001 * MS).is_some());
        assert_eq!(director.recoveries.longest_s(), 0.0, "what failed is no recovery");
        // A stage that does not exist is not counted as a fault.
        now += 300_000 * MS;
        order(&mut director, &mut now);
        director.not_sent(now);
        assert_eq!(director.recoveries.count(), 1);
        director.end();
        assert!(director.is_done());
    }

    #[test]
    fn heat_must_be_answered_and_pass() {
        let mut director = Director::new(DirectorParameters { mix: Mix::All, kills: None, ..PARAMETERS }, 0);
        let (mut now, mut heats) = (0, 0);
        while heats < 2 {
            let first = order(&mut director, &mut now);
            director.sent(now);
            if first.signal == Signal::Heat {
                // The daemon reacts to the second heat fault only.
                if heats == 1 {
                    director.held_up();
                }
                heats += 1;
                assert_eq!(director.result(now + 5 * MS, now + 10 * MS), None, "while it is hot");
                now += 3000 * MS;
                let cool = Order { stage: 0, signal: Signal::Cool };
                assert_eq!(director.tick(now, false), Some(cool));
                assert_eq!(director.recoveries.failures(), 1);
            } else if first.signal == Signal::Stop {
                now += 500 * MS;
                director.tick(now, false);
            }
            director.restarted(first.stage);
            now += 50 * MS;
            assert!(director.result(now - 30 * MS, now).is_some());
        }
        let rows = director.recoveries.rows();
        let row = rows.iter().find(|r| r.kind == FaultKind::Heat).unwrap();
        assert_eq!((row.stage, row.count, row.failed), ("the board", 2, 1));
    }

    #[test]
    fn a_stall_is_over_by_itself_and_measured_from_its_end() {
        let mut director = Director::new(DirectorParameters { mix: Mix::All, kills: None, ..PARAMETERS }, 0);
        let mut now = 0;
        let mut stalls = 0;
        for _ in 0..200 {
            let first = order(&mut director, &mut now);
            director.sent(now);
            let from = now;
            if first.signal == Signal::Stop {
                // A hang does not get this action.
                let next = (0..60).find_map(|_| {
                    now += 10 * MS;
                    director.tick(now, false)
                });
                if let Some(next) = next {
                    assert_eq!(next, Order { stage: first.stage, signal: Signal::Continue });
                    assert!(now - from < 420 * MS, "shorter than the liveness deadline");
                    stalls += 1;
                    assert_eq!(director.result(from + 5 * MS, now - MS), None, "before its end");
                }
            } else if first.signal == Signal::Heat {
                now += 3000 * MS;
                assert!(director.tick(now, false).is_some());
            }
            director.restarted(first.stage);
            now += 50 * MS;
            assert!(director.result(now - 30 * MS, now).is_some());
        }
        assert!(stalls > 10);
        assert_eq!(director.recoveries.count(), 200);
        assert!(director.recoveries.rows().iter().any(|r| r.kind == FaultKind::Hang));
    }
}
