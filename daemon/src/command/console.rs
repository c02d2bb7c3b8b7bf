//! Output of commands: lines on standard output, progress on standard error.

use crate::command::error::CommandError;
use crate::command::progress_lines::ProgressLines;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fmt;
use std::io::{self, IsTerminal, Write};

/// Prints a line to standard output. A closed pipe (`| head`) is not an error.
///
/// # Errors
/// If standard output cannot be written.
pub fn say(text: impl fmt::Display) -> Result<(), CommandError> {
    match writeln!(io::stdout().lock(), "{text}") {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(|e| CommandError::Other(format!("standard output: {e}"))),
    }
}

/// Progress on standard error: a bar if that is a terminal, otherwise a line a minute.
pub fn progress(count: Option<u64>, what: &str) -> ProgressBar {
    let is_terminal = io::stderr().is_terminal();
    let target = if is_terminal {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::term_like_with_hz(Box::new(ProgressLines::new(io::stderr())), 1)
    };
    let template = match (is_terminal, count) {
        (true, Some(_)) => format!("{{wide_bar}} {{pos}}/{{len}} {what}, {{msg}}"),
        (true, None) => format!("{{spinner}} {{pos}} {what}, {{msg}}"),
        (false, Some(_)) => {
            format!("{{pos}} of {{len}} {what} in {{elapsed_precise}}, about {{eta_precise}} left; {{msg}}")
        }
        (false, None) => format!("{{pos}} {what} in {{elapsed_precise}}; {{msg}}"),
    };
    let bar = ProgressBar::with_draw_target(count, target);
    match ProgressStyle::with_template(&template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
