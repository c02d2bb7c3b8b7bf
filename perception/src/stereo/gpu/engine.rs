//! A device with its queue, and its error handling.

use super::super::device::Loss;
use super::adapter::{AdapterDescription, GpuError, choose, instance};
use super::options::GpuOptions;
use super::uniforms::Plan;
use core::time::Duration;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Fault injection between a matcher and its device: an error of the gate is handled like one of the device.
pub trait Gate: Send {
    /// Called before each submission.
    ///
    /// # Errors
    /// If the device shall count as lost.
    fn submit(&mut self) -> Result<(), Loss> {
        Ok(())
    }

    /// Called before each wait; returns the time limit to use.
    ///
    /// # Errors
    /// If the device shall count as lost.
    fn wait(&mut self, patience: Duration) -> Result<Duration, Loss> {
        Ok(patience)
    }
}

/// A gate without faults.
struct Open;

impl Gate for Open {}

/// The first error that the driver reported from any thread; 0 is none.
#[derive(Clone, Debug, Default)]
pub(super) struct Trouble(Arc<AtomicU8>);

impl Trouble {
    fn set(&self, loss: Loss) {
        let number = match loss {
            Loss::Device => 1,
            Loss::OutOfMemory => 2,
            Loss::Hung => 3,
            Loss::Refused => 4,
        };
        // Keep the first error: it is the cause, later ones are consequences.
        let _ = self.0.compare_exchange(0, number, Ordering::AcqRel, Ordering::Acquire);
    }

    pub(super) fn check(&self) -> Result<(), Loss> {
        match self.0.load(Ordering::Acquire) {
            0 => Ok(()),
            1 => Err(Loss::Device),
            2 => Err(Loss::OutOfMemory),
            3 => Err(Loss::Hung),
            _ => Err(Loss::Refused),
        }
    }
}

fn loss_of(error: &wgpu::Error) -> Loss {
    match error {
        wgpu::Error::OutOfMemory { .. } => Loss::OutOfMemory,
        wgpu::Error::Validation { .. } | wgpu::Error::Internal { .. } => Loss::Refused,
    }
}

/// A device with its queue.
pub(super) struct Engine {
    pub(super) adapter: AdapterDescription,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) gate: Box<dyn Gate>,
    pub(super) trouble: Trouble,
    /// Minimum subgroup size; 1 without subgroup operations.
    pub(super) subgroup: u32,
    /// Nanoseconds of a timestamp tick; `None` without timestamps.
    pub(super) timestamp_ns: Option<f32>,
}

impl Engine {
    /// Opens the requested adapter, if its limits allow the plan.
    pub(super) fn open(options: &GpuOptions, plan: &Plan) -> Result<Self, GpuError> {
        let (adapter, limits) = find(options, plan)?;
        let info = adapter.get_info();
        let description = AdapterDescription::of(&info);
        let wanted = wgpu::Features::SUBGROUP | wgpu::Features::TIMESTAMP_QUERY;
        let features = adapter.features() & wanted;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("lookout"),
            required_features: features,
            required_limits: limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::Device { adapter: info.name.clone(), reason: error.to_string() })?;
        let trouble = Trouble::default();
        let reported = trouble.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| reported.set(loss_of(&error))));
        let reported = trouble.clone();
        device.set_device_lost_callback(move |_, _| reported.set(Loss::Device));
        let timestamp_ns =
            features.contains(wgpu::Features::TIMESTAMP_QUERY).then(|| queue.get_timestamp_period());
        let subgroup =
            if features.contains(wgpu::Features::SUBGROUP) { info.subgroup_min_size.max(1) } else { 1 };
        Ok(Self {
            adapter: description,
            device,
            queue,
            gate: Box::new(Open),
            trouble,
            subgroup,
            timestamp_ns,
        })
    }

    /// Runs `make`, which creates buffers and kernels, and returns the errors that the driver reported.
    pub(super) fn guarded<T>(&self, make: impl FnOnce() -> T) -> Result<T, GpuError> {
        let adapter = || self.adapter.name.clone();
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let refusal = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let made = make();
        let errors = [internal, refusal, memory].map(|scope| pollster::block_on(scope.pop()));
        if let Some(error) = errors.into_iter().flatten().next() {
            return Err(match loss_of(&error) {
                Loss::OutOfMemory => GpuError::Lost { adapter: adapter(), loss: Loss::OutOfMemory },
                _ => GpuError::Device { adapter: adapter(), reason: error.to_string() },
            });
        }
        self.trouble.check().map_err(|loss| GpuError::Lost { adapter: adapter(), loss })?;
        Ok(made)
    }

    /// A zeroed buffer.
    pub(super) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let mapped_at_creation = usage.contains(wgpu::BufferUsages::MAP_WRITE);
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.next_multiple_of(8).max(16),
            usage,
            mapped_at_creation,
        })
    }

    /// A buffer with the content `bytes`.
    pub(super) fn filled(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.buffer(label, bytes.len() as u64, usage | wgpu::BufferUsages::COPY_DST);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    pub(super) fn submit(&mut self, commands: wgpu::CommandBuffer) -> Result<wgpu::SubmissionIndex, Loss> {
        self.trouble.check()?;
        self.gate.submit()?;
        let index = self.queue.submit([commands]);
        self.trouble.check()?;
        Ok(index)
    }

    /// Waits until a submission has finished and its buffers are mapped.
    pub(super) fn wait(&mut self, index: wgpu::SubmissionIndex, patience: Duration) -> Result<(), Loss> {
        let patience = self.gate.wait(patience)?;
        let polled =
            self.device.poll(wgpu::PollType::Wait { submission_index: Some(index), timeout: Some(patience) });
        self.trouble.check()?;
        polled.map(|_| ()).map_err(|error| match error {
            wgpu::PollError::Timeout => Loss::Hung,
            // A lost device accepts no submissions.
            wgpu::PollError::WrongSubmissionIndex(..) => Loss::Device,
        })
    }
}

/// The requested adapter and the limits that the plan needs.
pub(super) fn find(options: &GpuOptions, plan: &Plan) -> Result<(wgpu::Adapter, wgpu::Limits), GpuError> {
    let adapter = choose(&instance(), &options.adapter, options.software)?;
    let limits = required(plan);
    let mut refused = None;
    limits.check_limits_with_fail_fn(&adapter.limits(), true, |what, needed, given| {
        refused = Some(GpuError::Limit { adapter: adapter.get_info().name, what, needed, given });
    });
    match refused {
        Some(refused) => Err(refused),
        None => Ok((adapter, limits)),
    }
}

/// The device limits that the kernels need.
fn required(plan: &Plan) -> wgpu::Limits {
    let largest = plan.largest_buffer();
    wgpu::Limits {
        max_storage_buffers_per_shader_stage: 5,
        max_storage_buffer_binding_size: largest.max(16 << 20),
        max_buffer_size: largest.max(16 << 20),
        max_compute_workgroup_storage_size: 12 << 10,
        max_compute_invocations_per_workgroup: 64,
        max_compute_workgroup_size_x: 64,
        max_compute_workgroup_size_y: 1,
        max_compute_workgroup_size_z: 1,
        max_compute_workgroups_per_dimension: 32_768,
        ..wgpu::Limits::downlevel_defaults()
    }
}
