//! The last frame that a client gave.

use crate::frame::Frame;
use messages::alarm::Faults;
use messages::depth::Depth;
use messages::header::Header;
use messages::obstacles::{AlarmRecord, Obstacles};
use messages::rig::RigRecord;

/// A result, and the run that it belongs to.
#[derive(Debug)]
pub(crate) struct Last {
    run: String,
    header: Header,
    obstacles: Obstacles,
    withdrawn: bool,
    /// Why this client withdrew it.
    ended: String,
}

impl Last {
    /// The result that follows `last`; `None` if it was given before, or withdraws what nobody was given.
    pub fn after(last: Option<&Self>, run: &str, header: Header, obstacles: Obstacles) -> Option<Self> {
        let withdrawn = header.withdraws == 1;
        let is_new = match last.filter(|last| last.run == run) {
            // A frame is repeated where a stage has died.
            Some(last) if !withdrawn => header.sequence > last.header.sequence,
            Some(last) => !last.withdrawn,
            None => !withdrawn,
        };
        let ended = String::new();
        is_new.then(|| Self { run: run.into(), header, obstacles, withdrawn, ended })
    }

    /// Withdraws it because results have ended. Returns false if it was withdrawn before.
    pub fn end(&mut self, reason: &str) -> bool {
        if self.withdrawn {
            return false;
        }
        self.withdrawn = true;
        self.ended = reason.into();
        let (sequence, source_ns) = (self.header.sequence, self.header.source_ns);
        self.header = Header::default();
        (self.header.sequence, self.header.source_ns) = (sequence, source_ns);
        self.obstacles = Obstacles { alarm: AlarmRecord::off(Faults::STAGE), obstacles: Default::default() };
        true
    }

    pub fn frame<'a>(&'a self, rig: &'a RigRecord, pictures: Option<Depth<'a>>) -> Frame<'a> {
        let header = &self.header;
        Frame {
            run: &self.run,
            sequence: header.sequence,
            source_ns: header.source_ns,
            capture_ns: header.capture_ns,
            result_ns: if self.withdrawn { 0 } else { header.result_ns() },
            width: header.width,
            height: header.height,
            modes: header.modes,
            withdrawn: self.withdrawn,
            alarm: &self.obstacles.alarm,
            obstacles: &self.obstacles.obstacles,
            motion: &header.motion,
            vehicle: &header.vehicle,
            rig,
            pictures: pictures.filter(|_| !self.withdrawn),
            ended: &self.ended,
        }
    }
}
