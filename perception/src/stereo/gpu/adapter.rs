//! Lists the adapters of this machine and chooses one.

use super::super::device::Loss;
use super::super::matcher::MatcherError;
use thiserror::Error;

/// Description of an adapter, for logs and messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterDescription {
    /// Name of the adapter.
    pub name: String,
    /// Name and version of its driver.
    pub driver: String,
    /// `discrete`, `integrated`, `virtual`, `other`, or `software` for a driver that computes on the CPU.
    pub kind: &'static str,
}

impl AdapterDescription {
    pub(super) fn of(info: &wgpu::AdapterInfo) -> Self {
        let (_, kind) = rank(info.device_type);
        let driver = format!("{} {}", info.driver, info.driver_info).trim().to_owned();
        Self { name: info.name.clone(), driver, kind }
    }
}

/// Errors of creating a matcher on a GPU. The messages name a remedy.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum GpuError {
    /// No adapter at all, or only software.
    #[error(
        "no Vulkan adapter{}: install the GPU's Vulkan driver (and let this user open /dev/dri/renderD*), or use the CPU",
        if *.software_alone { " except a software driver (name it in stereo.adapter to use it)" } else { "" }
    )]
    NoAdapter {
        /// There is an adapter with a software driver.
        software_alone: bool,
    },
    /// No adapter with that name.
    #[error("no adapter has `{wanted}` in its name; available: {}", if .known.is_empty() { "none" } else { .known })]
    UnknownAdapter {
        /// Part of a name.
        wanted: String,
        /// All names, joined.
        known: String,
    },
    /// The adapter cannot hold the matcher's buffers or run its kernels.
    #[error(
        "{adapter}: {what} is {given}, {needed} is needed: scale the images down, search fewer disparities, or use the CPU"
    )]
    Limit {
        /// The adapter.
        adapter: String,
        /// The limit.
        what: &'static str,
        /// What is needed.
        needed: u64,
        /// What the adapter has.
        given: u64,
    },
    /// The driver refuses a device.
    #[error("{adapter}: {reason}: use another adapter (stereo.adapter) or the CPU")]
    Device {
        /// The adapter.
        adapter: String,
        /// Why.
        reason: String,
    },
    /// The device was lost or ran out of memory while the matcher was created.
    #[error("{adapter}: {loss}: use another adapter (stereo.adapter) or the CPU")]
    Lost {
        /// The adapter.
        adapter: String,
        /// Why.
        loss: Loss,
    },
    /// Its map of a synthetic pair differs from the CPU's.
    #[error(
        "{adapter}: computes another map than the CPU ({pixels} pixels differ): update its driver, or use the CPU"
    )]
    Wrong {
        /// The adapter.
        adapter: String,
        /// Pixels that differ.
        pixels: usize,
    },
    /// The size or the number of disparities is not supported by any matcher.
    #[error(transparent)]
    Matcher(#[from] MatcherError),
}

/// Rank (lower is preferred) and name of a kind of adapter.
fn rank(kind: wgpu::DeviceType) -> (u8, &'static str) {
    match kind {
        wgpu::DeviceType::DiscreteGpu => (0, "discrete"),
        wgpu::DeviceType::IntegratedGpu => (1, "integrated"),
        wgpu::DeviceType::VirtualGpu => (2, "virtual"),
        wgpu::DeviceType::Other => (3, "other"),
        wgpu::DeviceType::Cpu => (4, "software"),
    }
}

pub(super) fn instance() -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

/// All adapters, the preferred ones first.
fn ranked(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut all = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    all.sort_by_key(|adapter| rank(adapter.get_info().device_type).0);
    all
}

/// All adapters of this machine, the preferred ones first.
pub fn adapters() -> Vec<AdapterDescription> {
    ranked(&instance()).iter().map(|adapter| AdapterDescription::of(&adapter.get_info())).collect()
}

pub(super) fn choose(
    instance: &wgpu::Instance,
    wanted: &str,
    software: bool,
) -> Result<wgpu::Adapter, GpuError> {
    let mut all = ranked(instance);
    let is_software = |adapter: &wgpu::Adapter| adapter.get_info().device_type == wgpu::DeviceType::Cpu;
    let found = if wanted.is_empty() {
        all.iter().position(|adapter| software || !is_software(adapter))
    } else {
        let wanted = wanted.to_lowercase();
        all.iter().position(|adapter| adapter.get_info().name.to_lowercase().contains(&wanted))
    };
    match found {
        Some(index) => Ok(all.swap_remove(index)),
        None if wanted.is_empty() => Err(GpuError::NoAdapter { software_alone: !all.is_empty() }),
        None => {
            let known: Vec<String> = all.iter().map(|adapter| adapter.get_info().name).collect();
            Err(GpuError::UnknownAdapter { wanted: wanted.to_owned(), known: known.join(", ") })
        }
    }
}
