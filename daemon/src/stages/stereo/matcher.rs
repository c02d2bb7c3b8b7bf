//! Construction of matchers from method and backend.

use super::parameters::mpv_parameters;
use crate::stages::whole_number::whole;
use clap::ValueEnum;
use config::Config;
use perception::simd::Level;
use perception::stereo::{Crew, CrewError, Matcher, MatcherError, Mpv, MpvParameters, Search};
use serde::Serialize;
use thiserror::Error;

/// What a pair is matched on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// A GPU where there is one and the build knows it, else the CPU
    Auto,
    /// The CPU
    Cpu,
    /// A GPU, through Vulkan
    Gpu,
}

impl Backend {
    /// The configured backend.
    pub fn configured(config: &Config) -> Self {
        match &config.stereo.backend[..] {
            "cpu" => Self::Cpu,
            "gpu" => Self::Gpu,
            _ => Self::Auto,
        }
    }
}

/// Why there is no matcher.
#[derive(Debug, Error)]
pub enum BackendError {
    /// The matcher does not support the size or the disparities.
    #[error(transparent)]
    Matcher(#[from] MatcherError),
    /// The matcher's threads cannot be started.
    #[error(transparent)]
    Crew(#[from] CrewError),
    /// This build has no GPU matcher.
    #[cfg(not(feature = "gpu"))]
    #[error(
        "stereo.backend = \"gpu\": this build has no GPU matcher: build with --features gpu, or set \"auto\" or \"cpu\""
    )]
    NotBuilt,
    /// The GPU cannot be used.
    #[cfg(feature = "gpu")]
    #[error("stereo.backend = \"gpu\": {0}")]
    Gpu(perception::stereo::gpu::GpuError),
}

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

    fn search(self) -> Search {
        match self {
            Self::Fast => Search::Windows,
            Self::Full => Search::Full,
        }
    }

    /// A matcher for pairs of `width` × `height` pixels and `disparities` disparities.
    ///
    /// # Errors
    /// If the matcher does not support the size or the disparities, or [`Backend::Gpu`] cannot be used.
    pub fn matcher(
        self,
        backend: Backend,
        config: &Config,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Box<dyn Matcher>, BackendError> {
        if let Some(matcher) = on_gpu(self.search(), backend, config, width, height, disparities)? {
            return Ok(matcher);
        }
        let crew = crew(config)?;
        Ok(Box::new(on_cpu(crew, mpv_parameters(config), self.search(), width, height, disparities)?))
    }
}

/// The threads of the configuration: those of the calling thread, if it has some.
fn crew(config: &Config) -> Result<Crew, CrewError> {
    Crew::new(whole(config.stereo.threads), |_| ())
}

fn on_cpu(
    crew: Crew,
    parameters: MpvParameters,
    search: Search,
    width: usize,
    height: usize,
    disparities: usize,
) -> Result<Mpv, MatcherError> {
    Mpv::with_crew(crew, Level::best(), parameters, search, width, height, disparities)
}

/// Checks the configured backend at start, without creating a matcher.
///
/// # Errors
/// If the GPU is configured and there is none, its limits are too low, or the build lacks the feature.
pub fn check(config: &Config, width: usize, height: usize) -> Result<(), BackendError> {
    if Backend::configured(config) != Backend::Gpu {
        return Ok(());
    }
    let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
    check_gpu(Method::configured(config).search(), config, width, height, disparities)
}

#[cfg(not(feature = "gpu"))]
fn check_gpu(_: Search, _: &Config, _: usize, _: usize, _: usize) -> Result<(), BackendError> {
    Err(BackendError::NotBuilt)
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(
    _: Search,
    backend: Backend,
    _: &Config,
    _: usize,
    _: usize,
    _: usize,
) -> Result<Option<Box<dyn Matcher>>, BackendError> {
    if backend == Backend::Gpu { Err(BackendError::NotBuilt) } else { Ok(None) }
}

#[cfg(feature = "gpu")]
fn options(backend: Backend, config: &Config) -> perception::stereo::gpu::GpuOptions {
    perception::stereo::gpu::GpuOptions {
        adapter: config.stereo.adapter.clone(),
        // A software adapter is slower than the CPU matcher, so it is used only if the GPU is configured explicitly.
        software: backend == Backend::Gpu,
        patience: std::time::Duration::from_secs_f64(config.stereo.gpu_timeout_ms * 1e-3),
    }
}

#[cfg(feature = "gpu")]
fn check_gpu(
    search: Search,
    config: &Config,
    width: usize,
    height: usize,
    disparities: usize,
) -> Result<(), BackendError> {
    let options = options(Backend::Gpu, config);
    perception::stereo::gpu::check(&options, mpv_parameters(config), search, width, height, disparities)
        .map(|_| ())
        .map_err(BackendError::Gpu)
}

/// A matcher on the GPU that falls back to the CPU if the device is lost; `None` if the CPU has to match.
#[cfg(feature = "gpu")]
fn on_gpu(
    search: Search,
    backend: Backend,
    config: &Config,
    width: usize,
    height: usize,
    disparities: usize,
) -> Result<Option<Box<dyn Matcher>>, BackendError> {
    use perception::stereo::fallback::Fallback;
    use perception::stereo::gpu::GpuMpv;
    if backend == Backend::Cpu {
        return Ok(None);
    }
    let (parameters, crew) = (mpv_parameters(config), crew(config)?);
    let made = GpuMpv::new(&options(backend, config), parameters, search, width, height, disparities)
        .and_then(|mut gpu| {
            gpu.verify(&mut Mpv::new(parameters, search, width, height, disparities)?)?;
            Ok(gpu)
        });
    match made {
        Ok(gpu) => {
            let replacement = move || -> Result<Box<dyn Matcher>, MatcherError> {
                Ok(Box::new(on_cpu(crew.clone(), parameters, search, width, height, disparities)?))
            };
            Ok(Some(Box::new(Fallback::new(Box::new(gpu), Box::new(replacement)))))
        }
        Err(error) if backend == Backend::Auto => {
            tracing::info!(%error, "matching on the CPU");
            Ok(None)
        }
        Err(error) => Err(BackendError::Gpu(error)),
    }
}
