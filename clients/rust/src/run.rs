//! One run of the daemon, as a client reads it.

use crate::options::Options;
use messages::bus::{Bus, IpcError};
use messages::depth::{self, Depth};
use messages::header::Header;
use messages::instance::Instance;
use messages::obstacles::{self, Newest, Obstacles};
use messages::port::{Sample, Subscriber};
use messages::rig::RigRecord;
use messages::run_files::RunPrefix;
use messages::wait::{self, Next};
use messages::{service, silence, status};
use std::time::{Duration, Instant};

/// Period of checking whether the daemon still runs.
pub(crate) const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// The ports of a client in a run.
#[derive(Debug)]
pub(crate) struct Run {
    /// The pictures that were given, or wait for their result.
    held: Option<Sample>,
    /// Whether the pictures were given.
    given: bool,
    /// A result that waits for its pictures.
    result: Option<Box<(Header, Obstacles)>>,
    results: Subscriber,
    statuses: Subscriber,
    /// `None` if no pictures are wanted.
    depths: Option<Subscriber>,
    _bus: Bus,
    instance: Instance,
    prefix: RunPrefix,
    newest: Newest,
    rig: RigRecord,
    /// Time of the last status.
    heard: Instant,
    checked: Instant,
    refused: u64,
}

/// What [`Run::next`] found.
#[derive(Debug)]
pub(crate) enum Found {
    /// A result, with its pictures held if they are wanted.
    Result(Box<(Header, Obstacles)>),
    /// Nothing in time.
    Nothing,
    /// The daemon answers no more, for this reason.
    Silent(String),
    /// The run has ended.
    End,
}

impl Run {
    /// Joins the current run of an instance.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn join(instance: &Instance, options: &Options) -> Result<Option<Self>, IpcError> {
        let Some(prefix) = instance.prefix() else { return Ok(None) };
        let bus = Bus::join(instance)?;
        let depths = options.pictures.then(|| bus.subscriber(&service::DEPTH)).transpose()?;
        let now = Instant::now();
        Ok(Some(Self {
            held: None,
            given: false,
            result: None,
            results: bus.subscriber(&service::OBSTACLES)?,
            statuses: bus.subscriber(&service::STATUS)?,
            depths,
            _bus: bus,
            instance: instance.clone(),
            prefix,
            newest: Newest::default(),
            rig: RigRecord::default(),
            heard: now,
            checked: now,
            refused: 0,
        }))
    }

    /// Its random characters.
    pub fn id(&self) -> &str {
        self.prefix.id()
    }

    /// Frame size and rig; all zeros until they are known.
    pub fn rig(&self) -> &RigRecord {
        &self.rig
    }

    /// Number of messages that failed their check.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// The pictures of the last result.
    pub fn pictures(&self) -> Option<Depth<'_>> {
        // What is not given yet belongs to a later result.
        let sample = self.held.as_ref().filter(|_| self.given)?;
        depth::view(sample.header(), sample.payload()).ok()
    }

    /// Returns the pictures that were given to the daemon.
    pub fn release(&mut self) {
        if std::mem::take(&mut self.given) {
            self.held = None;
        }
    }

    /// The newest result, with its pictures if they are wanted; waits for it until `until`.
    ///
    /// # Errors
    /// If the ports are broken.
    pub fn next(&mut self, until: Instant) -> Result<Found, IpcError> {
        let Self {
            held, given, result, results, statuses, depths, newest, rig, heard, checked, refused, ..
        } = self;
        let (instance, prefix) = (&self.instance, &self.prefix);
        let depths = depths.as_ref();
        let mut found = Found::Nothing;
        let subscribers: Vec<&Subscriber> = [&*results, &*statuses].into_iter().chain(depths).collect();
        wait::run::<IpcError>(&subscribers, || {
            while let Some(sample) = statuses.receive()? {
                match status::view(sample.header(), sample.payload()) {
                    Ok(status) => (*rig, *heard) = (status.rig, Instant::now()),
                    Err(_) => *refused += 1,
                }
            }
            while let Some(sample) = results.receive()? {
                match obstacles::view(sample.header(), sample.payload()) {
                    Ok(view) if newest.accepts(sample.header()) => {
                        *result = Some(Box::new((*sample.header(), view)))
                    }
                    Ok(_) => {}
                    Err(_) => *refused += 1,
                }
            }
            let is_withdrawn = result.as_ref().is_some_and(|result| result.0.withdraws == 1);
            if !is_withdrawn && let Some(depths) = depths {
                match_pictures(depths, held, result, refused)?;
            }
            let is_complete = result.is_some() && (is_withdrawn || depths.is_none() || held.is_some());
            if is_complete && let Some(result) = result.take() {
                *given = true;
                found = Found::Result(result);
                return Ok(Next::Stop);
            }
            let now = Instant::now();
            if now.duration_since(*checked) >= CHECK_PERIOD {
                *checked = now;
                if !instance.is_running() || instance.prefix().as_ref() != Some(prefix) {
                    found = Found::End;
                    return Ok(Next::Stop);
                }
                if heard.elapsed() > silence::TIMEOUT
                    && let Some(reason) = silence::reason(instance)
                {
                    found = Found::Silent(reason);
                    return Ok(Next::Stop);
                }
            }
            let left = until.saturating_duration_since(now);
            Ok(if left.is_zero() { Next::Stop } else { Next::Wait(left.min(CHECK_PERIOD)) })
        })?;
        Ok(found)
    }
}

/// Takes pictures until they belong to the result, or one of the two has to be waited for: what is older than the other is
/// given up, as its partner has been overtaken.
fn match_pictures(
    depths: &Subscriber,
    held: &mut Option<Sample>,
    result: &mut Option<Box<(Header, Obstacles)>>,
    refused: &mut u64,
) -> Result<(), IpcError> {
    loop {
        let Some(pictures) = held else {
            let Some(sample) = depths.receive()? else { return Ok(()) };
            match depth::view(sample.header(), sample.payload()) {
                Ok(_) => *held = Some(sample),
                Err(_) => *refused += 1,
            }
            continue;
        };
        let wanted = pictures.header().sequence;
        match result.as_ref().map(|result| result.0.sequence) {
            Some(sequence) if sequence > wanted => *held = None,
            Some(sequence) if sequence < wanted => *result = None,
            _ => return Ok(()),
        }
    }
}
