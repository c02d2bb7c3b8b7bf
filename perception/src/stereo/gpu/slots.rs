//! Upload and download buffers: two of each, so that the CPU accesses one while the GPU works on the other.

use super::super::device::{Loss, StageTime};
use super::engine::Engine;
use super::program::Program;
use crate::image::GreyView;
use core::time::Duration;
use wgpu::BufferUsages as Usage;

/// Maximum number of pairs in flight.
pub(super) const SLOTS: usize = 2;

/// Buffers for the upload of one pair and the download of its map.
pub(super) struct Slot {
    /// Mapped except while the GPU reads it.
    upload: wgpu::Buffer,
    /// Mapped after the GPU has written it.
    download: wgpu::Buffer,
    submitted: Option<wgpu::SubmissionIndex>,
    /// A copy of the left image, if holes are filled along its edges; otherwise empty.
    pub(super) left: Vec<u8>,
}

impl Slot {
    pub(super) fn new(engine: &Engine, program: &Program, keep_left: bool) -> Self {
        Self {
            upload: engine.buffer("upload", program.picture_bytes, Usage::MAP_WRITE | Usage::COPY_SRC),
            download: engine.buffer("download", program.download_bytes(), Usage::MAP_READ | Usage::COPY_DST),
            submitted: None,
            left: vec![0; if keep_left { program.pixels } else { 0 }],
        }
    }

    /// Bytes of memory held.
    pub(super) fn bytes(&self) -> usize {
        (self.upload.size() + self.download.size()) as usize + self.left.len()
    }

    /// Uploads a pair and submits its commands.
    pub(super) fn send(
        &mut self,
        engine: &mut Engine,
        program: &Program,
        left: GreyView<'_>,
        right: GreyView<'_>,
    ) -> Result<(), Loss> {
        engine.trouble.check()?;
        {
            let mut mapped = self.upload.get_mapped_range_mut(..).map_err(|_| Loss::Device)?;
            let (width, height) = (program.width, program.height);
            for (picture, image) in [left, right].into_iter().enumerate() {
                for y in 0..height {
                    let at = (picture * height + y) * program.row_bytes;
                    mapped.slice(at..at + width).copy_from_slice(&image.row(y)[..width]);
                }
            }
        }
        self.upload.unmap();
        if !self.left.is_empty() {
            for (y, row) in self.left.chunks_exact_mut(program.width).enumerate() {
                row.copy_from_slice(left.row(y));
            }
        }
        let mut encoder =
            engine.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("pair") });
        program.encode(&mut encoder, &self.upload, &self.download);
        let submitted = engine.submit(encoder.finish())?;
        // Driver errors surface in `wait`; a failed mapping surfaces when the range is requested.
        self.upload.slice(..).map_async(wgpu::MapMode::Write, |_| ());
        self.download.slice(..).map_async(wgpu::MapMode::Read, |_| ());
        self.submitted = Some(submitted);
        Ok(())
    }

    /// Waits for the submitted pair and copies its map. Returns its number of nodes.
    pub(super) fn receive(
        &mut self,
        engine: &mut Engine,
        program: &Program,
        patience: Duration,
        disparity: &mut [u16],
        confidence: &mut [u8],
        times: &mut [StageTime],
    ) -> Result<usize, Loss> {
        let submitted = self.submitted.take().ok_or(Loss::Hung)?;
        engine.wait(submitted, patience)?;
        let nodes = {
            let mapped = self.download.get_mapped_range(..).map_err(|_| Loss::Device)?;
            let bytes: &[u8] = &mapped;
            let (disparities, rest) = bytes.split_at(program.disparity_bytes() as usize);
            for (to, from) in disparity.iter_mut().zip(disparities.chunks_exact(2)) {
                *to = u16::from_le_bytes([from[0], from[1]]);
            }
            confidence.copy_from_slice(&rest[..program.pixels]);
            if let Some(unit_ns) = engine.timestamp_ns {
                times.iter_mut().for_each(|time| time.ns = 0);
                program.times_of(bytes, unit_ns, |stage, ns| times[stage].ns += ns);
            }
            program.nodes_of(bytes)
        };
        self.download.unmap();
        Ok(nodes)
    }
}
