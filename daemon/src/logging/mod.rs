//! Logging: readable lines on a terminal; under systemd, entries of the journal with fields, or lines with priorities
//! if only standard error is connected to the journal. Logging never blocks a process of the daemon.

mod journal;
mod queue;

use crate::printable::Escaping;
use journal::{Journal, priority};
use queue::Output;
pub use queue::{dropped, finish};
use std::fmt::{self, Write as _};
use std::io::IsTerminal;
use std::sync::OnceLock;
use tracing::field::Field;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::fmt::format::{FormatEvent, FormatFields, Writer, debug_fn};
use tracing_subscriber::fmt::{FmtContext, MakeWriter};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::{Layer, Registry, reload};

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
        let subscriber = tracing_subscriber::registry().with(filter).with(filter_fn(is_shown)).with(journal);
        // This fails only if logging was started before.
        if tracing::subscriber::set_global_default(subscriber).is_ok() {
            let _ = LEVEL.set(handle);
        }
        return;
    }
    let journal = std::env::var_os("JOURNAL_STREAM").is_some();
    let colour = !journal && std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let lines = lines(process, journal, colour, output);
    let subscriber = tracing_subscriber::registry().with(filter).with(filter_fn(is_shown)).with(lines);
    // This fails only if logging was started before.
    if tracing::subscriber::set_global_default(subscriber).is_ok() {
        let _ = LEVEL.set(handle);
    }
}

/// The layer that writes lines of text.
fn lines<S, W>(process: &'static str, journal: bool, colour: bool, output: W) -> impl Layer<S>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    W: for<'a> MakeWriter<'a> + 'static,
{
    tracing_subscriber::fmt::layer()
        .with_ansi(colour)
        .with_writer(output)
        .fmt_fields(debug_fn(put_field).delimited(" "))
        .event_format(Lines { process, journal, colour })
}

/// Whether an event is shown that its level lets pass. zenoh tells at each attempt to connect what the bridge tells once; the
/// levels debug and trace show that, too.
fn is_shown(metadata: &Metadata<'_>) -> bool {
    let is_own = !metadata.target().starts_with("zenoh");
    is_own || *metadata.level() == Level::ERROR || LevelFilter::current() >= LevelFilter::DEBUG
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

/// Writes a field of a line. Values come from outside, too, such as names of files: see [`crate::printable`].
fn put_field(writer: &mut Writer<'_>, field: &Field, value: &dyn fmt::Debug) -> fmt::Result {
    match field.name().trim_start_matches("r#") {
        "message" => {}
        // As the library does it: the name in italics.
        name if writer.has_ansi_escapes() => write!(writer, "\x1b[3m{name}\x1b[0m\x1b[2m=\x1b[0m")?,
        name => write!(writer, "{name}=")?,
    }
    write!(Escaping(writer), "{value:?}")
}

fn colour(level: Level) -> u8 {
    match level {
        Level::ERROR => 31,
        Level::WARN => 33,
        Level::INFO => 32,
        Level::DEBUG | Level::TRACE => 36,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{self, Write};
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct Buffer(Arc<Mutex<Vec<u8>>>);

    impl Write for Buffer {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl<'a> MakeWriter<'a> for Buffer {
        type Writer = Self;

        fn make_writer(&'a self) -> Self {
            self.clone()
        }
    }

    fn logged(colour: bool, act: impl FnOnce()) -> String {
        let buffer = Buffer::default();
        let lines = lines("capture", false, colour, buffer.clone());
        tracing::subscriber::with_default(tracing_subscriber::registry().with(lines), act);
        String::from_utf8(buffer.0.lock().unwrap().clone()).unwrap()
    }

    #[test]
    fn names_from_outside_forge_no_line() {
        let name = "a\nERROR scheduler: forged\u{1b}[2J";
        let text = logged(false, || {
            tracing::warn!(path = %name, quoted = name, n = 3, "{name}: cannot be read");
        });
        let escaped = "a\\nERROR scheduler: forged\\u{1b}[2J";
        assert_eq!(
            text,
            format!(" WARN capture: {escaped}: cannot be read path={escaped} quoted=\"{escaped}\" n=3\n")
        );
        let text = logged(true, || tracing::info!(path = %name, "started"));
        assert_eq!(
            text,
            format!(
                "\u{1b}[32m INFO\u{1b}[0m capture: started \u{1b}[3mpath\u{1b}[0m\u{1b}[2m=\u{1b}[0m{escaped}\n"
            )
        );
    }
}
