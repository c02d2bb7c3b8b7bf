//! Progress of the frames, and the command for the source: a pure state machine. Time is passed in.
//!
//! At live rate the source runs freely. In lock-step it may publish up to `credit`, which grows when that frame is
//! finished. If a stage died, the frame may be lost with it: the source is then requested to publish it again, by a
//! higher `attempt`. Stages that have already processed it repeat their result.

use super::heat::HeatAction;
use messages::command::CommandRecord;
use messages::header::modes;
use messages::pipeline::Role;

/// Maximum time to wait for the last frame after the source has stopped, in nanoseconds.
pub const DRAIN_NS: u64 = 3_000_000_000;

/// Number of frames by which the reports of a stage may be ahead of those of the source: reports of different stages
/// are read in any order.
const MAX_AHEAD: u64 = 1024;

/// Progress of the frames of a run.
#[derive(Clone, Debug)]
pub struct Credit {
    command: CommandRecord,
    /// Time between pairs before the thermal ladder, in nanoseconds.
    period_ns: u64,
    /// Share of the frame rate that the thermal ladder allows.
    rate_share: f64,
    /// Last pair that the source published.
    published: Option<u64>,
    /// Last frame of each process that has to finish a frame ([`Role::finishes_frames`]).
    finishing: Vec<(Role, Option<u64>)>,
    /// Whether the source has ended.
    finished: bool,
    /// A stage died: the frame in flight is requested again once all stages are running.
    request_again: bool,
    /// No stage has died since all were last running.
    all_running: bool,
    /// When a stage last finished a frame.
    moved_ns: u64,
    /// Time without progress after which a frame is lost; in lock-step it is then requested again.
    timeout_ns: u64,
}

impl Credit {
    /// The state before the first frame; `roles` are the processes of the run.
    pub fn new(lockstep: bool, roles: &[Role], period_ns: u64, timeout_ns: u64, now_ns: u64) -> Self {
        Self {
            command: CommandRecord { lockstep: u32::from(lockstep), period_ns, ..CommandRecord::default() },
            period_ns,
            rate_share: 1.0,
            published: None,
            finishing: roles.iter().filter(|r| r.finishes_frames()).map(|&r| (r, None)).collect(),
            finished: false,
            request_again: false,
            all_running: false,
            moved_ns: now_ns,
            timeout_ns,
        }
    }

    /// The current command for the source.
    pub fn command(&self) -> CommandRecord {
        self.command
    }

    fn is_lockstep(&self) -> bool {
        self.command.lockstep == 1
    }

    /// A stage finished frame `sequence`. Returns whether the command has changed.
    pub fn frame_done(&mut self, role: Role, sequence: u64, now_ns: u64) -> bool {
        // A frame that the source cannot have published is ignored.
        let max = if self.is_lockstep() {
            self.command.credit
        } else {
            self.published.unwrap_or(0).saturating_add(MAX_AHEAD)
        };
        if sequence > max && role != Role::SOURCE {
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
        // A stage died and was restarted before this frame was published, so it may have missed the frame.
        role == Role::SOURCE && self.all_running && std::mem::take(&mut self.request_again) && self.request()
    }

    /// The source left pair `sequence` out: nothing will finish it. Returns whether the command has changed.
    pub fn left_out(&mut self, sequence: u64, now_ns: u64) -> bool {
        self.moved_ns = now_ns;
        if !self.is_lockstep() || sequence != self.command.credit {
            return false;
        }
        self.command.credit = self.command.credit.saturating_add(1);
        self.command.attempt = 0;
        true
    }

    fn is_done(&self, sequence: u64) -> bool {
        self.finishing.iter().all(|(_, last)| *last >= Some(sequence))
    }

    fn request(&mut self) -> bool {
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
        self.request_again = true;
        self.all_running = false;
    }

    /// All stages are running. In lock-step, a frame that may be lost with a dead stage is requested again.
    pub fn all_running(&mut self, now_ns: u64) {
        self.moved_ns = now_ns;
        self.all_running = true;
        if self.is_lockstep() && self.request_again && self.published == Some(self.command.credit) {
            self.request_again = false;
            self.request();
        }
    }

    /// In lock-step, requests the frame again after `timeout_ns` without progress. Returns whether the command has
    /// changed.
    pub fn tick(&mut self, all_running: bool, now_ns: u64) -> bool {
        let stuck = self.is_lockstep()
            && all_running
            && self.published == Some(self.command.credit)
            && now_ns.saturating_sub(self.moved_ns) > self.timeout_ns;
        if stuck {
            self.moved_ns = now_ns;
        }
        stuck && self.request()
    }

    /// Whether the source has published a pair.
    pub fn has_pair(&self) -> bool {
        self.published.is_some()
    }

    /// Sets the time between two pairs before the thermal ladder, in nanoseconds.
    pub fn set_period(&mut self, period_ns: u64) {
        self.period_ns = period_ns;
        self.command.period_ns = (period_ns as f64 / self.rate_share) as u64;
    }

    /// Applies the limits of the thermal ladder. Returns whether the command has changed.
    pub fn limit(&mut self, heat: &HeatAction) -> bool {
        let before = self.command;
        self.rate_share = heat.frame_rate_share;
        self.set_period(self.period_ns);
        self.command.hold = u32::from(!heat.run);
        self.command.modes = if heat.recognition { 0 } else { modes::RECOGNITION_OFF };
        self.command != before
    }

    /// Makes the source stop.
    pub fn drain(&mut self) {
        self.command.drain = 1;
    }

    /// First sequence of a restarted source.
    pub fn resume_at(&self) -> u64 {
        match self.published {
            _ if self.is_lockstep() => self.command.credit,
            Some(last) => last.saturating_add(1),
            None => 0,
        }
    }

    /// Whether the last pair is finished, or is lost: at live rate that happens when a stage dies with the last frame,
    /// which no newer frame replaces.
    pub fn is_empty(&self, all_running: bool, now_ns: u64) -> bool {
        let done = self.published.is_none_or(|last| self.is_done(last));
        let timeout_ns = DRAIN_NS.max(self.timeout_ns);
        let lost = !self.is_lockstep() && all_running && now_ns.saturating_sub(self.moved_ns) > timeout_ns;
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
    fn credit_grows_when_the_frame_is_finished() {
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
        // A frame that the source was not allowed to publish is ignored.
        assert!(!flow.frame_done(Role::Recognition, u64::MAX, 8));
        assert_eq!(flow.command().credit, 2);
    }

    #[test]
    fn a_pair_that_the_source_leaves_out_is_not_waited_for() {
        let mut flow = flow(true, true);
        assert!(!flow.left_out(1, 1), "not its turn");
        assert!(flow.left_out(0, 1) && flow.left_out(1, 2));
        assert_eq!((flow.command().credit, flow.resume_at()), (2, 2));
        flow.frame_done(Role::Capture, 2, 3);
        flow.frame_done(Role::Recognition, 2, 3);
        assert!(flow.frame_done(Role::Writer, 2, 4));
        assert!(flow.left_out(3, 5) && flow.is_empty(true, 5), "the last pair is left out");
    }

    #[test]
    fn a_frame_that_was_lost_with_a_stage_is_requested_again() {
        let mut flow = flow(true, false);
        flow.all_running(0);
        assert_eq!(flow.command().attempt, 0, "nothing was lost at the start");
        flow.frame_done(Role::Capture, 0, 1);
        flow.stage_died();
        flow.all_running(2);
        assert_eq!((flow.command().credit, flow.command().attempt), (0, 1));
        assert!(flow.frame_done(Role::Recognition, 0, 3));
        assert_eq!((flow.command().credit, flow.command().attempt), (1, 0));
        // A stage that died before the source published: the frame is requested again after its publication.
        flow.stage_died();
        flow.all_running(4);
        assert_eq!(flow.command().attempt, 0);
        assert!(flow.frame_done(Role::Capture, 1, 5));
        assert_eq!(flow.command().attempt, 1);
        assert!(!flow.frame_done(Role::Capture, 1, 6), "requested once");
        assert_eq!(flow.resume_at(), 1);
    }

    #[test]
    fn a_frame_that_was_published_while_a_stage_was_down_is_requested_after_its_restart() {
        let mut flow = flow(true, false);
        flow.all_running(0);
        flow.frame_done(Role::Capture, 0, 1);
        flow.stage_died();
        // The others finish frame 0, and the source continues before the dead stage is running again.
        assert!(flow.frame_done(Role::Recognition, 0, 2));
        assert!(!flow.frame_done(Role::Capture, 1, 3), "requested now, it would be lost again");
        flow.all_running(4);
        assert_eq!((flow.command().credit, flow.command().attempt), (1, 1));
    }

    #[test]
    fn a_frame_without_progress_is_requested_again() {
        let mut flow = flow(true, false);
        flow.frame_done(Role::Capture, 0, S);
        assert!(!flow.tick(true, 6 * S));
        assert!(!flow.tick(false, 7 * S), "a stage is missing");
        assert!(flow.tick(true, 7 * S) && !flow.tick(true, 8 * S));
        assert_eq!(flow.command().attempt, 1);
    }

    #[test]
    fn the_thermal_ladder_scales_every_period() {
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
        // The pacer changes the period while the board is hot, and the board cools down after that.
        flow.set_period(150);
        assert_eq!(flow.command().period_ns, 300);
        assert!(!flow.limit(&hot) && flow.limit(&cool));
        assert_eq!(flow.command().period_ns, 150);
    }

    #[test]
    fn at_live_rate_the_wait_for_the_last_frame_is_limited() {
        let mut flow = flow(false, true);
        assert!(flow.is_empty(true, 0), "nothing was published");
        flow.frame_done(Role::Capture, 9, S);
        flow.frame_done(Role::Recognition, u64::MAX, S);
        assert!(!flow.is_empty(true, S), "no such frame was published");
        flow.source_finished();
        assert!(flow.is_finished() && !flow.is_empty(true, 2 * S));
        flow.frame_done(Role::Recognition, 9, 2 * S);
        assert!(!flow.is_empty(true, 3 * S));
        assert!(!flow.is_empty(false, 60 * S), "a stage is restarting");
        assert!(!flow.is_empty(true, 7 * S) && flow.is_empty(true, 8 * S), "the frame is lost");
        flow.frame_done(Role::Writer, 9, 3 * S);
        assert!(flow.is_empty(true, 3 * S));
        assert_eq!(flow.resume_at(), 10);
        flow.drain();
        assert_eq!(flow.command().drain, 1);
    }
}
