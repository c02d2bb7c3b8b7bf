//! The matcher on a GPU: the same Multi-Path-Viterbi as [`super::mpv`], by compute shaders through Vulkan.
//!
//! Every stage does the integers of the CPU's plain twin, and the few floats of the cost in the same order
//! and rounding, so that the map is the same, bit for bit. Layout, shaders and how they are mapped to the
//! hardware: `docs/gpu.md`.
//!
//! A matcher has two slots. [`GpuMpv::submit`] uploads a pair and sends its work off without waiting,
//! [`GpuMpv::collect`] waits for the oldest and reads its map, so that one pair is uploaded and another
//! read back while the GPU works. [`Matcher::compute`] does both one after the other.
//!
//! A device may be lost at any time. That is [`MatchError::Lost`]; the matcher is useless from then on,
//! and [`super::fallback::Fallback`] puts another in its place.

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

/// Checks whether a matcher can be made as far as the adapter and its limits go, without making it.
///
/// # Errors
/// As [`GpuMpv::new`], but for what only the driver knows.
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

/// The matcher on a GPU with all its buffers.
pub struct GpuMpv {
    width: usize,
    height: usize,
    patience: Duration,
    adapter: String,
    driver: String,
    fill: Fill,
    complete: bool,
    /// None once the device is lost.
    work: Option<Box<Work>>,
    loss: Option<Loss>,
    /// Slots in flight, the oldest first.
    order: [usize; SLOTS],
    in_flight: usize,
    next: usize,
    times: Vec<StageTime>,
    nodes: usize,
}

/// What goes with the device.
struct Work {
    engine: Engine,
    program: Program,
    slots: [Slot; SLOTS],
}

impl GpuMpv {
    /// A matcher for pairs of `width` × `height` pixels and disparities 0 to `disparities` − 1.
    ///
    /// # Errors
    /// When there is no such adapter, its limits are too low, the driver refuses a kernel or the memory,
    /// or as [`Mpv::new`].
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
            fill: Fill::new(parameters.bridge, width),
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

    /// Lets `gate` stand between the matcher and its device: for tests of what may go wrong.
    pub fn set_gate(&mut self, gate: Box<dyn Gate>) {
        if let Some(work) = &mut self.work {
            work.engine.gate = gate;
        }
    }

    /// Makes the driver give the device up, as a reset does: for tests.
    pub fn destroy_device(&self) {
        if let Some(work) = &self.work {
            work.engine.device.destroy();
        }
    }

    /// Pairs that were submitted and not collected, at most [`Self::max_in_flight`].
    pub fn in_flight(&self) -> usize {
        self.in_flight
    }

    /// The most pairs in flight.
    pub fn max_in_flight(&self) -> usize {
        SLOTS
    }

    /// Uploads a pair and sends its work off, without waiting.
    ///
    /// # Errors
    /// When an image has another size than the matcher, all slots are taken (which counts as a device that
    /// does not answer), or the device is lost.
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
    /// When an output is not `width` × `height`, nothing is in flight (which counts as a device that does
    /// not answer), or the device is lost.
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

    /// Leaves the device. Nothing of it is dropped: tearing a lost or hanging device down may hang, too.
    fn give_up(&mut self, loss: Loss) -> MatchError {
        std::mem::forget(self.work.take());
        self.loss = Some(loss);
        self.in_flight = 0;
        MatchError::Lost(loss)
    }
}

impl Matcher for GpuMpv {
    /// The GPU always finishes: `go_on` is not asked, and the map is the finest.
    fn compute_within(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        _: &mut dyn FnMut() -> bool,
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
