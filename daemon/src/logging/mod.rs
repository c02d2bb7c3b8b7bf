//! Logging: readable lines on a terminal; under systemd, entries of the journal with fields, or lines with priorities
//! if only standard error is connected to the journal. Logging never blocks a process of the daemon.

mod journal;
mod queue;

use journal::{Journal, priority};
use queue::Output;
pub use queue::{dropped, finish};
use std::fmt;
use std::io::IsTerminal;
use std::sync::OnceLock;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::FmtContext;
use tracing_subscriber::fmt::format::{FormatEvent, FormatFields, Writer};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::{Registry, reload};

/// One line per event: `<6>stereo: message key=value` under systemd, which adds the time itself;
/// `INFO stereo: message key=value` elsewhere.
struct Lines {
    process: &'static str,
    journal: bool,
    colour: bool,
}

/// Handle for changing the level.
static LEVEL: OnceLock<reload::Handle<LevelFilter, Registry>> = OnceLock::new();

/// Sets the least severe level that is logged.
pub fn set_level(level: &str) {
    if let (Some(handle), Ok(filter)) = (LEVEL.get(), level.parse::<LevelFilter>()) {
        // This fails only if the subscriber has been dropped.
        let _ = handle.reload(filter);
    }
}

/// Starts logging to the journal or to standard error. Every line starts with `process`; `level` is one of `error`,
/// `warn`, `info`, `debug` and `trace`. Processes of the daemon put their lines into a queue that never blocks; other
/// commands write them directly.
pub fn start(process: &'static str, level: &str) {
    let filter: LevelFilter = level.parse().unwrap_or(LevelFilter::INFO);
    messages::bus::set_library_log_level();
    messages::stall::set_report(|text| {
        tracing::error!("{text}");
        finish();
    });
    let (filter, handle) = reload::Layer::new(filter);
    let output = if is_daemon(process) { Output::queued() } else { Output::direct() };
    if let Some(journal) = Journal::open(process, output) {
        let subscriber = tracing_subscriber::registry().with(filter).with(journal);
        // This fails only if logging was started before.
        if tracing::subscriber::set_global_default(subscriber).is_ok() {
            let _ = LEVEL.set(handle);
        }
        return;
    }
    let journal = std::env::var_os("JOURNAL_STREAM").is_some();
    let colour = !journal && std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let lines = tracing_subscriber::fmt::layer().with_ansi(colour).with_writer(output).event_format(Lines {
        process,
        journal,
        colour,
    });
    let subscriber = tracing_subscriber::registry().with(filter).with(lines);
    // This fails only if logging was started before.
    if tracing::subscriber::set_global_default(subscriber).is_ok() {
        let _ = LEVEL.set(handle);
    }
}

fn is_daemon(process: &str) -> bool {
    process.parse::<messages::pipeline::Role>().is_ok()
}

impl<S, N> FormatEvent<S, N> for Lines
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let level = *event.metadata().level();
        if self.journal {
            write!(writer, "<{}>{}: ", priority(level), self.process)?;
        } else if self.colour {
            write!(writer, "\x1b[{}m{level:>5}\x1b[0m {}: ", colour(level), self.process)?;
        } else {
            write!(writer, "{level:>5} {}: ", self.process)?;
        }
        context.field_format().format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}

fn colour(level: Level) -> u8 {
    match level {
        Level::ERROR => 31,
        Level::WARN => 33,
        Level::INFO => 32,
        Level::DEBUG | Level::TRACE => 36,
    }
}
