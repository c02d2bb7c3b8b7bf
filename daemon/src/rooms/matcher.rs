//! Makes matchers by the name of their method.

use super::mpv_parameters;
use clap::ValueEnum;
use config::Config;
use perception::stereo::{Matcher, MatcherError, Mpv, Search};
use serde::Serialize;

/// How a pair is matched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Windows around a coarser map
    Fast,
    /// All disparities of every pixel
    Full,
}

impl Method {
    /// Its name on the command line and in the configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Full => "full",
        }
    }

    /// The configured method.
    pub fn configured(config: &Config) -> Self {
        if config.stereo.method == Self::Full.name() { Self::Full } else { Self::Fast }
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
        let search = match self {
            Self::Fast => Search::Windows,
            Self::Full => Search::Full,
        };
        Ok(Box::new(Mpv::new(mpv_parameters(config), search, width, height, disparities)?))
    }
}
