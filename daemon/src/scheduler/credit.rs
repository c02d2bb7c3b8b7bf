//! Where frames are, and what the source may do next: a pure state machine. Time is passed in.
//!
//! At live rate the source runs freely. In lock-step it may publish up to `credit`; the credit grows
//! when that frame has gone all the way. When a stage died it may have taken the frame along: then
//! the source is asked for it once more, by a higher `attempt`; stages that had already worked on it
//! give the same answer again.

use super::heat::HeatAction;
use messages::command::CommandRecord;
use messages::header::modes;
use messages::pipeline::Role;

/// How long the last frame may be on its way once the source has stopped.
pub const DRAIN_NS: u64 = 3_000_000_000;

/// Frames by which a stage's report may be read before the source's own.
const MAX_AHEAD: u64 = 1024;

/// The frames of a run.
#[derive(Clone, Debug)]
pub struct Credit {
    command: CommandRecord,
    /// Time between pairs when the board is not hot.
    period_ns: u64,
    /// What heat leaves of the frame rate.
    rate_share: f64,
    /// Last pair that the source published.
    published: Option<u64>,
    /// Last frame of each process without which no frame is done.
    finishing: Vec<(Role, Option<u64>)>,
    finished: bool,
    /// A stage died; the frame in flight is to be asked for again once all are there.
    ask_again: bool,
    /// No stage has died since all were last running.
    all_there: bool,
    /// When any frame last moved.
    moved_ns: u64,
    /// A frame that no stage finishes for this long is lost; in lock-step it is asked for again.
    patience_ns: u64,
}

impl Credit {
    /// No frame has moved yet; `roles` are the processes of the run.
    pub fn new(lockstep: bool, roles: &[Role], period_ns: u64, patience_ns: u64, now_ns: u64) -> Self {
        Self {
            command: CommandRecord { lockstep: u32::from(lockstep), period_ns, ..CommandRecord::default() },
            period_ns,
            rate_share: 1.0,
            published: None,
            finishing: roles.iter().filter(|r| r.finishes_frames()).map(|&r| (r, None)).collect(),
            finished: false,
            ask_again: false,
            all_there: false,
            moved_ns: now_ns,
            patience_ns,
        }
    }

    /// What the source is to do.
    pub fn command(&self) -> CommandRecord {
        self.command
    }

    fn is_lockstep(&self) -> bool {
        self.command.lockstep == 1
    }

    /// A stage finished frame `sequence`. Gives whether the source has to be told something new.
    pub fn frame_done(&mut self, role: Role, sequence: u64, now_ns: u64) -> bool {
        // Reports of different stages are read in any order, but nobody runs far ahead of the source.
        let most = if self.is_lockstep() {
            self.command.credit
        } else {
            self.published.unwrap_or(0).saturating_add(MAX_AHEAD)
        };
        if sequence > most && role != Role::SOURCE {
            return false;
        }
        self.moved_ns = now_ns;
        let place = match self.finishing.iter_mut().find(|(finishing, _)| *finishing == role) {
            Some((_, last)) => last,
            None if role == Role::SOURCE => &mut self.published,
            None => return false,
        };
        *place = (*place).max(Some(sequence));
        if !self.is_lockstep() {
            return false;
        }
        if self.is_done(self.command.credit) {
            self.command.credit = self.command.credit.saturating_add(1);
            self.command.attempt = 0;
            return true;
        }
        // A stage died and came back before this frame was published; it may have missed it.
        role == Role::SOURCE && self.all_there && std::mem::take(&mut self.ask_again) && self.ask()
    }

    fn is_done(&self, sequence: u64) -> bool {
        self.finishing.iter().all(|(_, last)| *last >= Some(sequence))
    }

    fn ask(&mut self) -> bool {
        self.command.attempt += 1;
        true
    }

    /// The source has no more pairs, or has stopped.
    pub fn source_finished(&mut self) {
        self.finished = true;
    }

    /// Whether the source has no more pairs, or has stopped.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    /// A stage died.
    pub fn stage_died(&mut self) {
        self.ask_again = true;
        self.all_there = false;
    }

    /// All stages are there: the source is to be told what to do. In lock-step, a frame that a dead
    /// stage may have taken along is asked for again.
    pub fn all_running(&mut self, now_ns: u64) {
        self.moved_ns = now_ns;
        self.all_there = true;
        if self.is_lockstep() && self.ask_again && self.published == Some(self.command.credit) {
            self.ask_again = false;
            self.ask();
        }
    }

    /// In lock-step, asks for the frame again when it has not moved for long. Gives whether the
    /// source has to be told.
    pub fn tick(&mut self, all_running: bool, now_ns: u64) -> bool {
        let stuck = self.is_lockstep()
            && all_running
            && self.published == Some(self.command.credit)
            && now_ns.saturating_sub(self.moved_ns) > self.patience_ns;
        if stuck {
            self.moved_ns = now_ns;
        }
        stuck && self.ask()
    }

    /// Whether any pair has come.
    pub fn has_pair(&self) -> bool {
        self.published.is_some()
    }

    /// The time between two pairs, in nanoseconds, when the board is not hot.
    pub fn set_period(&mut self, period_ns: u64) {
        self.period_ns = period_ns;
        self.command.period_ns = (period_ns as f64 / self.rate_share) as u64;
    }

    /// What heat leaves of the work. Gives whether the source has to be told.
    pub fn limit(&mut self, heat: &HeatAction) -> bool {
        let before = self.command;
        self.rate_share = heat.frame_rate_share;
        self.set_period(self.period_ns);
        self.command.hold = u32::from(!heat.run);
        self.command.modes = if heat.recognition { 0 } else { modes::RECOGNITION_OFF };
        self.command != before
    }

    /// The source is to stop.
    pub fn drain(&mut self) {
        self.command.drain = 1;
    }

    /// Where a restarted source goes on.
    pub fn resume_at(&self) -> u64 {
        match self.published {
            _ if self.is_lockstep() => self.command.credit,
            Some(last) => last.saturating_add(1),
            None => 0,
        }
    }

    /// Whether the last pair has come out at the end, or will not come any more: at live rate the
    /// newest frame is only lost when a stage dies with it, for it has no successor.
    pub fn is_empty(&self, all_running: bool, now_ns: u64) -> bool {
        let done = self.published.is_none_or(|last| self.is_done(last));
        let patience_ns = DRAIN_NS.max(self.patience_ns);
        let lost = !self.is_lockstep() && all_running && now_ns.saturating_sub(self.moved_ns) > patience_ns;
        done || lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn flow(lockstep: bool, with_writer: bool) -> Credit {
        let writer = with_writer.then_some(Role::Writer);
        let roles: Vec<Role> = Role::STAGES.into_iter().chain(writer).collect();
        Credit::new(lockstep, &roles, 100, 5 * S, 0)
    }

    #[test]
    fn credit_grows_when_the_frame_has_gone_all_the_way() {
        let mut flow = flow(true, true);
        assert_eq!(flow.command().credit, 0);
        assert!(!flow.frame_done(Role::Capture, 0, 1));
        assert!(!flow.frame_done(Role::Stereo, 0, 2));
        assert!(!flow.frame_done(Role::Recognition, 0, 3), "the writer is not done");
        assert!(!flow.is_empty(true, 4));
        assert!(flow.frame_done(Role::Writer, 0, 4));
        assert_eq!(flow.command().credit, 1);
        // Reports of different stages may be read in any order.
        assert!(!flow.frame_done(Role::Writer, 1, 5) && flow.frame_done(Role::Recognition, 1, 6));
        assert_eq!(flow.command().credit, 2);
        assert!(flow.is_empty(true, 7));
        // A frame that nobody was allowed to publish is a lie.
        assert!(!flow.frame_done(Role::Recognition, u64::MAX, 8));
        assert_eq!(flow.command().credit, 2);
    }

    #[test]
    fn a_frame_that_died_with_a_stage_is_asked_for_again() {
        let mut flow = flow(true, false);
        flow.all_running(0);
        assert_eq!(flow.command().attempt, 0, "nothing was lost at the start");
        flow.frame_done(Role::Capture, 0, 1);
        flow.stage_died();
        flow.all_running(2);
        assert_eq!((flow.command().credit, flow.command().attempt), (0, 1));
        assert!(flow.frame_done(Role::Recognition, 0, 3));
        assert_eq!((flow.command().credit, flow.command().attempt), (1, 0));
        // Died before the source had published: asked for when it has.
        flow.stage_died();
        flow.all_running(4);
        assert_eq!(flow.command().attempt, 0);
        assert!(flow.frame_done(Role::Capture, 1, 5));
        assert_eq!(flow.command().attempt, 1);
        assert!(!flow.frame_done(Role::Capture, 1, 6), "asked for once");
        assert_eq!(flow.resume_at(), 1);
    }

    #[test]
    fn a_frame_that_was_published_while_a_stage_was_away_is_asked_for_when_it_is_back() {
        let mut flow = flow(true, false);
        flow.all_running(0);
        flow.frame_done(Role::Capture, 0, 1);
        flow.stage_died();
        // The others finish frame 0, and the source goes on before the dead one is back.
        assert!(flow.frame_done(Role::Recognition, 0, 2));
        assert!(!flow.frame_done(Role::Capture, 1, 3), "asked for now it would be lost again");
        flow.all_running(4);
        assert_eq!((flow.command().credit, flow.command().attempt), (1, 1));
    }

    #[test]
    fn a_frame_that_does_not_move_is_asked_for_again() {
        let mut flow = flow(true, false);
        flow.frame_done(Role::Capture, 0, S);
        assert!(!flow.tick(true, 6 * S));
        assert!(!flow.tick(false, 7 * S), "a stage is missing");
        assert!(flow.tick(true, 7 * S) && !flow.tick(true, 8 * S));
        assert_eq!(flow.command().attempt, 1);
    }

    #[test]
    fn heat_takes_its_share_of_whatever_period_is_set() {
        let mut flow = flow(false, false);
        let cool = HeatAction {
            frame_rate_share: 1.0,
            clocks_share: 1.0,
            recognition: true,
            run: true,
            power_off: false,
        };
        let hot = HeatAction { frame_rate_share: 0.5, ..cool };
        assert!(!flow.limit(&cool));
        assert!(flow.limit(&hot) && !flow.limit(&hot));
        assert_eq!(flow.command().period_ns, 200);
        // The pacer changes its mind while the board is hot, and the board cools down after that.
        flow.set_period(150);
        assert_eq!(flow.command().period_ns, 300);
        assert!(!flow.limit(&hot) && flow.limit(&cool));
        assert_eq!(flow.command().period_ns, 150);
    }

    #[test]
    fn at_live_rate_the_last_frame_is_awaited_but_not_for_ever() {
        let mut flow = flow(false, true);
        assert!(flow.is_empty(true, 0), "nothing was published");
        flow.frame_done(Role::Capture, 9, S);
        flow.frame_done(Role::Recognition, u64::MAX, S);
        assert!(!flow.is_empty(true, S), "no such frame was published");
        flow.source_finished();
        assert!(flow.is_finished() && !flow.is_empty(true, 2 * S));
        flow.frame_done(Role::Recognition, 9, 2 * S);
        assert!(!flow.is_empty(true, 3 * S));
        assert!(!flow.is_empty(false, 60 * S), "a stage is coming back");
        assert!(!flow.is_empty(true, 7 * S) && flow.is_empty(true, 8 * S), "the frame is lost");
        flow.frame_done(Role::Writer, 9, 3 * S);
        assert!(flow.is_empty(true, 3 * S));
        assert_eq!(flow.resume_at(), 10);
        flow.drain();
        assert_eq!(flow.command().drain, 1);
    }
}
