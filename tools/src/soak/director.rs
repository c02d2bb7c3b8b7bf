//! When which fault is made: a pure state machine. Time is passed in.
//!
//! ```text
//!        pause over, results flow          signal sent                  next result of the restarted stage
//! Calm ───────────────────────────▶ Asked ────────────▶ Recovering ───────────────────────────────────────▶ Calm
//!                                     │ a stall is over      ▲ │ patience ends: counted as failed, waits on
//!                                     └──▶ Stalled ──────────┘
//! ```
//!
//! Heat is a stall of the whole daemon by its thermal ladder.

use super::fault::{Fault, FaultKind, Mix, StageNames};
use super::recovery::Recoveries;

/// A result must have been captured this long after the signal to show anything: a frame may have
/// been under way while it was delivered.
const SIGNAL_NS: u64 = 2_000_000;

/// How faults are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectorParameters {
    /// Which.
    pub mix: Mix,
    /// The stages.
    pub stages: StageNames,
    /// Seed of all that is drawn.
    pub seed: u64,
    /// Mean pause from a recovery to the next fault, in nanoseconds; drawn evenly from half to one
    /// and a half of it.
    pub pause_ns: u64,
    /// When the daemon takes a silent stage for hung.
    pub liveness_ns: u64,
    /// A recovery that takes longer has failed.
    pub patience_ns: u64,
    /// No more faults after this many SIGKILLs.
    pub kills: Option<u64>,
}

/// What is to be sent to a stage.
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
    /// No signal: the board's temperature goes to where the stages must wait.
    Heat,
    /// And back.
    Cool,
}

/// A signal to a stage, or what stands for one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// To which.
    pub stage: usize,
    /// Which.
    pub signal: Signal,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Calm { next_ns: u64 },
    Asked { fault: Fault },
    Stalled { fault: Fault, from_ns: u64, until_ns: u64 },
    Recovering { fault: Fault, from_ns: u64, since_ns: u64, restarted: bool, failed: bool },
}

/// Makes faults, one at a time, and waits for the recovery from each.
#[derive(Clone, Debug)]
pub struct Director {
    parameters: DirectorParameters,
    random: fastrand::Rng,
    state: State,
    start_ns: u64,
    /// Whether the daemon has answered to the heat.
    held_up: bool,
    ends: bool,
    /// What came of the faults.
    pub recoveries: Recoveries,
}

/// A fault that was recovered from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// When it was made.
    pub from_ns: u64,
    /// When the next result was there.
    pub result_ns: u64,
}

impl Director {
    /// A director whose first fault comes after a pause.
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

    /// What is due; `steady` says that all stages run and results flow.
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

    /// The first signal of a fault was sent; `sent_ns` is the time after that.
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

    /// It could not be sent: the stage was not there.
    pub fn not_sent(&mut self, now_ns: u64) {
        if matches!(self.state, State::Asked { .. }) {
            self.calm(now_ns);
        }
    }

    /// The daemon says that heat has stopped its stages. Heat without such an answer has failed.
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

    /// A result came out.
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

    /// When the fault was made that is not yet recovered from.
    pub fn open_since_ns(&self) -> Option<u64> {
        match self.state {
            State::Stalled { from_ns, .. } | State::Recovering { from_ns, .. } => Some(from_ns),
            State::Calm { .. } | State::Asked { .. } => None,
        }
    }

    /// Makes no more faults.
    pub fn end(&mut self) {
        self.ends = true;
    }

    fn is_over(&self) -> bool {
        self.ends || self.parameters.kills.is_some_and(|kills| self.recoveries.kills() >= kills)
    }

    /// Whether no more faults come and the last one is recovered from, or given up.
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

    /// Ticks until an order comes.
    fn order(director: &mut Director, now: &mut u64) -> Order {
        for _ in 0..1000 {
            *now += 10 * MS;
            if let Some(order) = director.tick(*now, true) {
                return order;
            }
        }
        panic!("no order came");
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
        // In flight when it happened, or captured while the signal was on its way.
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
        // Another stage's restart shows nothing.
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
        // A stage that is not there is no fault.
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
                // The daemon answers to the second alone.
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
                // A hang never gets this order.
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
