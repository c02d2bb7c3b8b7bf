//! Makes matchers by the name of their method.

use super::mpv_parameters;
use clap::ValueEnum;
use config::Config;
use perception::stereo::{FullMpv, Matcher, MatcherError};
use serde::Serialize;

/// How a pair is matched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Full-range Multi-Path-Viterbi
    Full,
}

impl Method {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
        }
    }

    /// A matcher for pairs of `width` × `height`.
    ///
    /// # Errors
    /// When the images are too small or too large, or the disparities do not fit.
    pub fn matcher(
        self,
        config: &Config,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Box<dyn Matcher>, MatcherError> {
        Ok(match self {
            Self::Full => Box::new(FullMpv::new(mpv_parameters(config), width, height, disparities)?),
        })
    }
}
