//! Recording of a run by its writer, for `lookout replay --record`. In lock-step the next pair is published only after
//! this one is in the file, so the recording is complete.

use crate::host::{Host, HostError};
use crate::recorder::{Feed, Plan};
use messages::header::Header;
use messages::obstacles::Obstacles;
use messages::port::Subscriber;
use messages::{pair, service, status};
use std::path::Path;
use tools::recording::{Choice, ImageForm, Limits};

/// Why a message with other images is refused.
pub(super) const WRONG_SIZE: &str = "its size is not that of the run";

/// The recorder of the writer.
pub struct InlineRecorder {
    statuses: Subscriber,
    feed: Feed,
}

impl InlineRecorder {
    /// Creates the file. If it exists, a previous writer of the run has died, and the recording continues in a numbered
    /// file.
    ///
    /// # Errors
    /// If the file cannot be written, or shared memory cannot be used.
    pub fn start(host: &Host, path: &Path) -> Result<Self, HostError> {
        let continues = path.exists();
        let limits = Limits { split_ns: continues.then_some(u64::MAX), ..Limits::default() };
        let instance = host.launch.config.instance.name.clone();
        let plan = Plan { form: ImageForm::Raw, topics: Choice::default(), limits, instance };
        let frames = host.launch.frames;
        let size = (frames.width as u32, frames.height as u32);
        Ok(Self {
            statuses: host.bus.subscriber(&service::STATUS)?,
            feed: Feed::start(path, plan, frames.rig(), size, host.launch.lockstep)?,
        })
    }

    /// Records the pairs and the status messages that have arrived.
    ///
    /// # Errors
    /// If shared memory cannot be used.
    pub fn follow(&mut self, host: &mut Host, pairs: &Subscriber) -> Result<(), HostError> {
        while let Some(sample) = pairs.receive()? {
            match pair::view(sample.header(), sample.payload()) {
                Err(error) => host.refused("pair", &error),
                Ok(_) if !host.launch.frames.has_size(sample.header()) => {
                    host.refused("pair", &WRONG_SIZE);
                }
                Ok(pair) => {
                    if let Err(error) = self.feed.pair(sample.header(), &pair) {
                        host.refused("pair", &error);
                    }
                }
            }
        }
        self.feed.missed("pair", pairs.take_missed());
        while let Some(sample) = self.statuses.receive()? {
            if let Ok(status) = status::view(sample.header(), sample.payload()) {
                self.feed.status(&status);
            }
        }
        Ok(())
    }

    /// Whether the last recorded pair is that of frame `sequence`.
    pub fn has_pair(&self, sequence: u64) -> bool {
        self.feed.last_pair() == Some(sequence)
    }

    /// Records the result of a frame.
    pub fn result(&mut self, header: &Header, message: &Obstacles, missed: u64) {
        self.feed.missed("obstacles", missed);
        self.feed.obstacles(header, message);
    }

    /// Whether the recording has ended before the run.
    pub fn is_over(&self) -> bool {
        self.feed.is_over()
    }

    /// Completes the file.
    ///
    /// # Errors
    /// The reason if the recording ended early.
    pub fn finish(self) -> Result<(), HostError> {
        self.feed.finish("the run has ended")?;
        Ok(())
    }
}
