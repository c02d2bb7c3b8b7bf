//! A source whose vehicle's motion comes from a file, or is left out.

use super::motion_table::MotionTable;
use crate::vehicle::VehicleReading;
use crate::{Geometry, LiveSource, PairSource, SourceError};
use perception::rig::Rig;
use std::path::Path;

/// The pairs of another source, with the vehicle's motion from a file.
pub struct MotionSource {
    inner: Box<dyn PairSource>,
    /// `None`: the vehicle reports nothing.
    table: Option<MotionTable>,
    /// Time of the first frame on the clock of the file, in seconds.
    origin_s: f64,
    stale_s: f64,
}

impl MotionSource {
    /// Takes the motion from the file `path`, see [`MotionTable::read`]. `origin_s` is the time of the first frame on the
    /// clock of the file; a sample is used up to `stale_s` from a frame.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn new(
        inner: Box<dyn PairSource>,
        path: &Path,
        origin_s: f64,
        stale_s: f64,
    ) -> Result<Self, SourceError> {
        let count = inner.count().unwrap_or(0);
        let times_s: Vec<f64> = (0..count).map(|index| inner.time_ns(index) as f64 * 1e-9).collect();
        let table = MotionTable::read(path, &times_s)?;
        let origin_s = if table.is_of_frames() { 0.0 } else { origin_s };
        Ok(Self { inner, table: Some(table), origin_s, stale_s })
    }

    /// Leaves out what the vehicle reports.
    pub fn silent(inner: Box<dyn PairSource>) -> Self {
        Self { inner, table: None, origin_s: 0.0, stale_s: 0.0 }
    }
}

impl PairSource for MotionSource {
    fn size(&self) -> (usize, usize) {
        self.inner.size()
    }

    fn rig(&self) -> Option<Rig> {
        self.inner.rig()
    }

    fn geometry(&self) -> Geometry {
        self.inner.geometry()
    }

    fn rig_file(&self) -> Option<&Path> {
        self.inner.rig_file()
    }

    fn count(&self) -> Option<u64> {
        self.inner.count()
    }

    fn period_ns(&self) -> u64 {
        self.inner.period_ns()
    }

    fn time_ns(&self, index: u64) -> u64 {
        self.inner.time_ns(index)
    }

    fn vehicle(&self, index: u64) -> VehicleReading {
        let time_s = self.origin_s + self.inner.time_ns(index) as f64 * 1e-9;
        self.table.as_ref().map(|table| table.at(time_s, self.stale_s)).unwrap_or_default()
    }

    fn live(&mut self) -> Option<&mut dyn LiveSource> {
        self.inner.live()
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        self.inner.read(index, left, right)
    }
}
