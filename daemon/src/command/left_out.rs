//! Pairs of a recording that cannot be read: commands leave them out, tell each, and count them.

use crate::command::error::CommandError;
use crate::in_process::PipelineError;
use sources::truth::TruthError;
use std::fmt::Display;
use std::path::Path;

/// An error of which a command can tell whether it is that of one pair.
pub trait PairError: Display {
    /// Whether one pair is damaged and the others may be fine.
    fn is_of_one_pair(&self) -> bool;
}

impl PairError for PipelineError {
    fn is_of_one_pair(&self) -> bool {
        matches!(self, Self::Source(error) if error.is_of_one_pair())
    }
}

impl PairError for CommandError {
    fn is_of_one_pair(&self) -> bool {
        match self {
            // A map of the ground truth is a picture, too.
            Self::Source(error) | Self::Truth(TruthError::Source(error)) => error.is_of_one_pair(),
            _ => false,
        }
    }
}

/// Pairs that were left out.
#[derive(Default)]
pub struct LeftOut {
    /// Their number.
    pub count: u64,
    last: Option<String>,
}

impl LeftOut {
    /// The result of a pair, which its number or name tells; `None` if it is left out. With `strict` none is.
    ///
    /// # Errors
    /// That of the pair, unless it is left out.
    pub fn unless_broken<T, E: PairError>(
        &mut self,
        pair: impl Display,
        is_strict: bool,
        result: Result<T, E>,
    ) -> Result<Option<T>, E> {
        match result {
            Err(error) if error.is_of_one_pair() && !is_strict => {
                tracing::warn!(%pair, "pair left out: {error}");
                self.count += 1;
                self.last = Some(error.to_string());
                Ok(None)
            }
            result => result.map(Some),
        }
    }

    /// Checks that a pair was read.
    ///
    /// # Errors
    /// If all `pairs` were left out; with the reason of the last.
    pub fn check(&self, pairs: u64) -> Result<(), CommandError> {
        match &self.last {
            Some(last) if self.count >= pairs => {
                Err(CommandError::Other(format!("no pair can be read: {last}")))
            }
            _ => Ok(()),
        }
    }

    /// Says on standard error how many there are, if any.
    pub fn warn(&self, recording: &Path) {
        if self.count > 0 {
            eprintln!("{}{}; --strict stops there", recording.display(), self.told().replacen(';', ":", 1));
        }
    }

    /// What is said of them beside results; empty if there are none.
    pub fn told(&self) -> String {
        match self.count {
            0 => String::new(),
            1 => "; 1 pair left out, because it cannot be read".into(),
            n => format!("; {n} pairs left out, because they cannot be read"),
        }
    }
}
