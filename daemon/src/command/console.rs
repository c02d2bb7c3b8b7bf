//! Output of commands: lines on standard output, progress bars on a terminal.

use crate::command::error::CommandError;
use indicatif::{ProgressBar, ProgressStyle};
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

/// A progress bar on standard error if that is a terminal, otherwise a hidden one.
pub fn progress(count: Option<u64>, what: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let (bar, template) = match count {
        Some(count) => (ProgressBar::new(count), format!("{{wide_bar}} {{pos}}/{{len}} {what}, {{msg}}")),
        None => (ProgressBar::no_length(), format!("{{spinner}} {{pos}} {what}, {{msg}}")),
    };
    match ProgressStyle::with_template(&template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
