//! Frequencies of clocks, and errors of setting them.

use std::fmt;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// A frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hertz(pub u64);

impl Hertz {
    /// From megahertz.
    pub fn from_mhz(mhz: f64) -> Self {
        Self((mhz * 1e6).round() as u64)
    }

    /// In megahertz.
    pub fn mhz(self) -> f64 {
        self.0 as f64 * 1e-6
    }

    /// A share of it.
    pub(super) fn times(self, share: f64) -> Self {
        Self((self.0 as f64 * share).round() as u64)
    }
}

impl fmt::Display for Hertz {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.0} MHz", self.mhz())
    }
}

/// Why clocks cannot be set or restored.
#[derive(Debug, Error)]
pub enum ClockError {
    /// The board has no such clock.
    #[error("no {what} clock below {}: set clocks.{what}_mhz to 0, or correct [board]", root.display())]
    Missing {
        /// `cpu` or `gpu`.
        what: &'static str,
        /// The root that was searched.
        root: PathBuf,
    },
    /// The kernel refuses.
    #[error("{}: {source}: run as a user who may write it (docs/operations.md), or set clocks.set = \"off\"", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file with the original values cannot be used.
    #[error("{}: {reason}: the original clocks are not known; a restart of the board restores them", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// The cause.
        reason: String,
    },
}
