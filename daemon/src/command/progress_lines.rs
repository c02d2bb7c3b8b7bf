//! Progress where nobody looks at a terminal: in a log file, a line a minute.

use indicatif::TermLike;
use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time from one line to the next, and from the start to the first: a short command prints none.
const EVERY: Duration = Duration::from_secs(60);

/// A "terminal" that prints what a progress bar draws as lines, at most one a minute.
#[derive(Debug)]
pub struct ProgressLines<W> {
    every: Duration,
    state: Mutex<State<W>>,
}

#[derive(Debug)]
struct State<W> {
    writer: W,
    /// What was drawn since the last flush.
    drawn: String,
    /// Time of the last line, or of the start.
    last: Instant,
}

impl<W: Write> ProgressLines<W> {
    /// Prints to a writer.
    pub fn new(writer: W) -> Self {
        Self::with_interval(writer, EVERY)
    }

    fn with_interval(writer: W, every: Duration) -> Self {
        Self { every, state: Mutex::new(State { writer, drawn: String::new(), last: Instant::now() }) }
    }

    fn draw(&self, text: &str) -> io::Result<()> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).drawn.push_str(text);
        Ok(())
    }
}

impl<W: Write + std::fmt::Debug + Send> TermLike for ProgressLines<W> {
    fn width(&self) -> u16 {
        200
    }

    fn move_cursor_up(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn write_line(&self, text: &str) -> io::Result<()> {
        self.draw(text)
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        self.draw(text)
    }

    fn clear_line(&self) -> io::Result<()> {
        Ok(())
    }

    fn flush(&self) -> io::Result<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let drawn = std::mem::take(&mut state.drawn);
        // Without a message nothing follows the semicolon.
        let line = drawn.trim().trim_end_matches(';');
        if line.is_empty() || state.last.elapsed() < self.every {
            return Ok(());
        }
        state.last = Instant::now();
        writeln!(state.writer, "{line}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(lines: ProgressLines<Vec<u8>>) -> String {
        String::from_utf8(lines.state.into_inner().unwrap().writer).unwrap()
    }

    fn draw(lines: &ProgressLines<Vec<u8>>) {
        for text in ["  3 of 10 runs; ", "", "4 of 10 runs; fast"] {
            lines.write_str(text).unwrap();
            lines.flush().unwrap();
        }
    }

    #[test]
    fn what_a_bar_draws_becomes_a_line_now_and_then() {
        let always = ProgressLines::with_interval(Vec::new(), Duration::ZERO);
        draw(&always);
        assert_eq!(text(always), "3 of 10 runs\n4 of 10 runs; fast\n");
        let hourly = ProgressLines::with_interval(Vec::new(), Duration::from_secs(3600));
        draw(&hourly);
        let Some(an_hour_ago) = Instant::now().checked_sub(Duration::from_secs(3601)) else { return };
        hourly.state.lock().unwrap().last = an_hour_ago;
        draw(&hourly);
        assert_eq!(
            text(hourly),
            "3 of 10 runs\n",
            "a short command prints none, a long one at most one an hour"
        );
    }
}
