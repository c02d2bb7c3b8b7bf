//! The matcher on a GPU: the same Multi-Path-Viterbi as [`super::mpv`] in Vulkan compute shaders.
//!
//! Every stage does the same integer arithmetic as the CPU's reference implementation, and the few
//! floating-point operations of the cost in the same order and rounding, so the maps are bit-identical. Memory
//! layout, shaders and their mapping to the hardware: `docs/gpu.md`.
//!
//! A matcher has two slots. [`GpuMpv::submit`] uploads a pair and submits its commands without waiting.
//! [`GpuMpv::collect`] waits for the oldest pair and reads its map. One pair can so be uploaded and another
//! read back while the GPU works. [`Matcher::compute`] does both one after the other.
//!
//! A device may be lost at any time. The matcher then returns [`MatchError::Lost`] for this pair and all later
//! ones, and [`super::fallback::Fallback`] replaces it.

mod adapter;
mod engine;
mod kernels;
mod options;
mod program;
mod slots;
mod uniforms;
mod verify;

pub use adapter::{AdapterDescription, GpuError, adapters};
pub use engine::Gate;
pub use options::GpuOptions;

use super::device::{DeviceState, Loss, STAGES, StageTime};
use super::fill::Fill;
use super::matcher::{MatchError, MatchOutput, Matcher};
use super::mpv::{Mpv, MpvParameters, Search};
use crate::image::GreyView;
use core::time::Duration;
use engine::Engine;
use program::Program;
use slots::{SLOTS, Slot};

/// Checks parameters, adapter and limits without creating a matcher.
///
/// # Errors
/// As [`GpuMpv::new`], except for errors that only the driver detects.
pub fn check(
    options: &GpuOptions,
    parameters: MpvParameters,
    search: Search,
    width: usize,
    height: usize,
    disparities: usize,
) -> Result<AdapterDescription, GpuError> {
    Mpv::check(width, height, disparities)?;
    let plan = uniforms::plan(&parameters, search, width, height, disparities);
    engine::find(options, &plan).map(|(adapter, _)| AdapterDescription::of(&adapter.get_info()))
}

/// The Multi-Path-Viterbi matcher on a GPU, with all its buffers.
pub struct GpuMpv {
    width: usize,
    height: usize,
    patience: Duration,
    adapter: String,
    driver: String,
    fill: Fill,
    complete: bool,
    /// `None` after the device was lost.
    work: Option<Box<Work>>,
    loss: Option<Loss>,
    /// Slots in flight, the oldest first.
    order: [usize; SLOTS],
    in_flight: usize,
    next: usize,
    times: Vec<StageTime>,
    nodes: usize,
}

/// All resources of the device.
struct Work {
    engine: Engine,
    program: Program,
    slots: [Slot; SLOTS],
}

impl GpuMpv {
    /// A matcher for pairs of `width` × `height` pixels and disparities 0 to `disparities` − 1.
    ///
    /// # Errors
    /// If there is no such adapter, its limits are too low, or the driver refuses a kernel or memory; and as
    /// [`Mpv::new`].
    pub fn new(
        options: &GpuOptions,
        parameters: MpvParameters,
        search: Search,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Self, GpuError> {
        Mpv::check(width, height, disparities)?;
        let plan = uniforms::plan(&parameters, search, width, height, disparities);
        let engine = Engine::open(options, &plan)?;
        let (program, slots) = engine.guarded(|| {
            let program = Program::new(&engine, &plan);
            let slots = std::array::from_fn(|_| Slot::new(&engine, &program, parameters.complete));
            (program, slots)
        })?;
        let adapter = engine.adapter.name.clone();
        let driver = engine.adapter.driver.clone();
        let times = if engine.timestamp_ns.is_some() {
            STAGES.iter().map(|stage| StageTime { stage, ns: 0 }).collect()
        } else {
            Vec::new()
        };
        Ok(Self {
            width,
            height,
            patience: options.patience,
            adapter,
            driver,
            fill: Fill::new(parameters.bridge, width, 1),
            complete: parameters.complete,
            work: Some(Box::new(Work { engine, program, slots })),
            loss: None,
            order: [0; SLOTS],
            in_flight: 0,
            next: 0,
            times,
            nodes: 0,
        })
    }

    /// Installs a gate between the matcher and its device, for fault injection in tests.
    pub fn set_gate(&mut self, gate: Box<dyn Gate>) {
        if let Some(work) = &mut self.work {
            work.engine.gate = gate;
        }
    }

    /// Destroys the device, which has the effect of a driver reset; for tests.
    pub fn destroy_device(&self) {
        if let Some(work) = &self.work {
            work.engine.device.destroy();
        }
    }

    /// Pairs that were submitted and not yet collected, at most [`Self::max_in_flight`].
    pub fn in_flight(&self) -> usize {
        self.in_flight
    }

    /// Maximum number of pairs in flight.
    pub fn max_in_flight(&self) -> usize {
        SLOTS
    }

    /// Uploads a pair and submits its commands, without waiting.
    ///
    /// # Errors
    /// If an image has another size than the matcher, all slots are in use (reported as
    /// [`Loss::Hung`]), or the device is lost.
    pub fn submit(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> Result<(), MatchError> {
        let (expected_width, expected_height) = (self.width, self.height);
        for (which, image) in [("left", &left), ("right", &right)] {
            let (width, height) = (image.width(), image.height());
            if (width, height) != (expected_width, expected_height) {
                return Err(MatchError::Size { which, width, height, expected_width, expected_height });
            }
        }
        if self.in_flight == SLOTS {
            return Err(MatchError::Lost(Loss::Hung));
        }
        let Some(work) = &mut self.work else {
            return Err(MatchError::Lost(self.loss.unwrap_or(Loss::Device)));
        };
        let Work { engine, program, slots } = &mut **work;
        match slots[self.next].send(engine, program, left, right) {
            Ok(()) => {
                self.order[self.in_flight] = self.next;
                self.in_flight += 1;
                self.next = (self.next + 1) % SLOTS;
                Ok(())
            }
            Err(loss) => Err(self.give_up(loss)),
        }
    }

    /// Waits for the oldest pair in flight and writes its map.
    ///
    /// # Errors
    /// If an output does not have `width` × `height` values, no pair is in flight (reported as
    /// [`Loss::Hung`]), or the device is lost.
    pub fn collect(&mut self, output: MatchOutput<'_>) -> Result<(), MatchError> {
        let needed = self.width * self.height;
        for given in [output.disparity.len(), output.confidence.len()] {
            if given != needed {
                return Err(MatchError::Output { given, needed });
            }
        }
        let Some(work) = self.work.as_mut().filter(|_| self.in_flight > 0) else {
            return Err(MatchError::Lost(self.loss.unwrap_or(Loss::Hung)));
        };
        let Work { engine, program, slots } = &mut **work;
        let slot = &mut slots[self.order[0]];
        self.order.rotate_left(1);
        self.in_flight -= 1;
        let MatchOutput { disparity, confidence } = output;
        match slot.receive(engine, program, self.patience, disparity, confidence, &mut self.times) {
            Ok(nodes) => self.nodes = nodes,
            Err(loss) => return Err(self.give_up(loss)),
        }
        if self.complete
            && let Ok(left) = GreyView::new(&slot.left, self.width, self.height, self.width)
        {
            self.fill.complete(left, disparity, confidence);
        }
        Ok(())
    }

    /// Abandons the device. Its resources are leaked on purpose: releasing a lost or hanging device may hang.
    fn give_up(&mut self, loss: Loss) -> MatchError {
        std::mem::forget(self.work.take());
        self.loss = Some(loss);
        self.in_flight = 0;
        MatchError::Lost(loss)
    }
}

impl Matcher for GpuMpv {
    /// The GPU always finishes: `go_on` is not called, and the map has the full resolution.
    fn compute_within(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        _: &mut (dyn FnMut() -> bool + Send),
    ) -> Result<u32, MatchError> {
        let needed = self.width * self.height;
        for given in [output.disparity.len(), output.confidence.len()] {
            if given != needed {
                return Err(MatchError::Output { given, needed });
            }
        }
        self.submit(left, right)?;
        self.collect(output).map(|()| 0)
    }

    fn nodes(&self) -> usize {
        self.nodes
    }

    fn workspace_bytes(&self) -> usize {
        self.work.as_ref().map_or(0, |work| work.program.bytes + SLOTS * work.slots[0].bytes())
    }

    fn device(&self) -> Option<DeviceState<'_>> {
        Some(DeviceState {
            adapter: &self.adapter,
            driver: &self.driver,
            stages: &self.times,
            loss: self.loss,
        })
    }
}

#[cfg(test)]
mod tests;
