//! What a detector's score says: log-odds of its class, fitted on labelled regions (Platt 1999).
//!
//! The file is text. A line that begins with `#` is a comment. Then, in this order: `lookout-calibration 1`, `prior P`,
//! `miss M`, `offset A`, `slope B`, all log-odds. `lookout evaluate classes --calibrate` writes it.

use super::Recognition;
use crate::excerpt::{VALUE_CHARS, excerpt};
use std::fmt;
use thiserror::Error;

/// Bytes of a file: five lines and comments.
pub const MAX_BYTES: u64 = 64 << 10;

/// Largest log-odds in a file: a probability of 1 − 1e-9.
const MAX_LOG_ODDS: f64 = 20.0;

/// Most that one look adds to the log-odds of a class: a factor of 20. A fit knows nothing of what it has never seen.
const MAX_EVIDENCE: f64 = 3.0;

/// What a look adds without a calibration: three looks of one mind reach the bound of a track.
const VOTE: f64 = 4.0 / 3.0;

/// Log-odds of a distance of 1 from the SVM's plane, without a calibration.
const SVM_SLOPE: f64 = 2.0;

/// Log-odds of a class by the score of a detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Before anything was looked at: how many of the regions that are classified are of the class.
    pub prior: f64,
    /// Where nothing was found.
    pub miss: f64,
    /// Where something was found: `offset + slope · score`.
    pub offset: f64,
    /// See `offset`.
    pub slope: f64,
}

/// Why a file is no calibration.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum CalibrationError {
    /// The file is too large.
    #[error("{0} bytes: a calibration has at most {MAX_BYTES}")]
    TooLarge(usize),
    /// A line is missing or wrong.
    #[error("line {line}: \"{found}\" should be \"{expected}\"")]
    Line {
        /// Line of the file, from 1; 0 at its end.
        line: usize,
        /// Excerpt of the line.
        found: String,
        /// What should stand there.
        expected: String,
    },
}

impl Calibration {
    /// Each look is a vote: for a detector that nobody has calibrated.
    pub const VOTES: Self = Self { prior: 0.0, miss: -VOTE, offset: VOTE, slope: 0.0 };

    /// For a linear SVM that nobody has calibrated.
    pub const SVM: Self = Self { prior: 0.0, miss: -VOTE, offset: 0.0, slope: SVM_SLOPE };

    /// For a score that is the log-odds of the class.
    pub const LOG_ODDS: Self = Self { prior: 0.0, miss: 0.0, offset: 0.0, slope: 1.0 };

    /// What a look adds to the log-odds of the class.
    pub fn evidence(&self, found: Option<Recognition>) -> f64 {
        let log_odds = found.map_or(self.miss, |found| self.offset + self.slope * f64::from(found.score));
        (log_odds - self.prior).clamp(-MAX_EVIDENCE, MAX_EVIDENCE)
    }

    /// Reads a calibration from the text of its file.
    ///
    /// # Errors
    /// If a line is not what it should be; the error names it.
    pub fn read(text: &str) -> Result<Self, CalibrationError> {
        if text.len() as u64 > MAX_BYTES {
            return Err(CalibrationError::TooLarge(text.len()));
        }
        let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let wrong = |(line, found): (usize, &str), expected: String| CalibrationError::Line {
            line,
            found: excerpt(found, VALUE_CHARS).into_owned(),
            expected,
        };
        const HEAD: &str = "lookout-calibration 1";
        let head = lines.next().unwrap_or_default();
        if head.1 != HEAD {
            return Err(wrong(head, HEAD.into()));
        }
        let mut number = |name: &str| {
            let line = lines.next().unwrap_or_default();
            let words = line.1.split_once(' ').filter(|(first, _)| *first == name);
            let value = words.and_then(|(_, value)| value.parse::<f64>().ok());
            value.filter(|v| (-MAX_LOG_ODDS..=MAX_LOG_ODDS).contains(v)).ok_or_else(|| {
                wrong(line, format!("{name} N, a number from {} to {MAX_LOG_ODDS}", -MAX_LOG_ODDS))
            })
        };
        let calibration = Self {
            prior: number("prior")?,
            miss: number("miss")?,
            offset: number("offset")?,
            slope: number("slope")?,
        };
        match lines.next() {
            Some(line) => Err(wrong(line, "the end".into())),
            None => Ok(calibration),
        }
    }

    /// The calibration with values that its file may hold.
    #[must_use]
    pub fn limited(self) -> Self {
        let within = |v: f64| if v.is_nan() { 0.0 } else { v.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS) };
        Self {
            prior: within(self.prior),
            miss: within(self.miss),
            offset: within(self.offset),
            slope: within(self.slope),
        }
    }
}

/// The lines of the file.
impl fmt::Display for Calibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { prior, miss, offset, slope } = self;
        writeln!(f, "lookout-calibration 1\nprior {prior:.4}\nmiss {miss:.4}")?;
        writeln!(f, "offset {offset:.4}\nslope {slope:.4}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(score: f32) -> Option<Recognition> {
        Some(Recognition { score, x: 0, y: 0, width: 1, height: 1 })
    }

    #[test]
    fn a_calibration_is_read_as_it_is_written_and_wrong_lines_are_named() {
        let calibration = Calibration { prior: -1.5, miss: -2.25, offset: 0.5, slope: 2.0 };
        let text = format!("# by a test\n{calibration}");
        assert_eq!(Calibration::read(&text).unwrap(), calibration);
        for (text, expected) in [
            (text.replace("miss -2.25", "miss NaN"), "line 4: \"miss NaN"),
            (text.replace("slope 2", "slope 21"), "line 6"),
            (text.replace("offset", "ofset"), "should be \"offset N"),
            (text.replace("slope 2.0000", ""), "line 0: \"\" should be \"slope N"),
            (format!("{text}more\n"), "line 7: \"more\" should be \"the end\""),
            ("<xml>".into(), "lookout-calibration 1"),
            (" ".repeat(1 << 17), "at most 65536"),
        ] {
            let error = Calibration::read(&text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        let wild = Calibration { prior: f64::NAN, miss: -1e9, ..calibration }.limited();
        assert_eq!(Calibration::read(&wild.to_string()).unwrap(), wild);
    }

    #[test]
    fn evidence_is_what_a_look_adds_to_the_prior_and_bounded() {
        let calibration = Calibration { prior: -1.0, miss: -2.0, offset: 0.0, slope: 1.0 };
        assert_eq!(calibration.evidence(None), -1.0);
        assert_eq!(calibration.evidence(found(0.5)), 1.5);
        assert_eq!(calibration.evidence(found(1e9)), MAX_EVIDENCE);
        assert_eq!(calibration.evidence(found(-1e9)), -MAX_EVIDENCE);
        assert_eq!(Calibration::VOTES.evidence(found(7.0)), -Calibration::VOTES.evidence(None));
    }
}
