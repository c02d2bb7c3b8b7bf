//! Rectification of unrectified pairs.

use crate::rig_file::RigFile;
use crate::vehicle::VehicleReading;
use crate::{Geometry, LiveSource, PairSource, SourceError};
use perception::image::GreyView;
use perception::rectify::Remap;
use perception::rig::Rig;
use std::path::PathBuf;

/// Rectifies the pairs of another source. Allocates nothing per pair.
pub struct RectifiedSource {
    inner: Box<dyn PairSource>,
    tables: [Remap; 2],
    rig: Rig,
    /// A pair before rectification.
    raw: [Vec<u8>; 2],
    path: PathBuf,
}

impl RectifiedSource {
    /// Rectifies the pairs of `inner` with the rig `file`, which was read from `path`.
    ///
    /// # Errors
    /// When the file is for images of another size.
    pub fn new(inner: Box<dyn PairSource>, file: &RigFile, path: PathBuf) -> Result<Self, SourceError> {
        let (width, height) = inner.size();
        file.check_size((width, height))
            .map_err(|reason| SourceError::Calibration { path: path.clone(), reason })?;
        let tables = [0, 1].map(|side| Remap::rectifying(&file.cameras, &file.rectification, side));
        let raw = [vec![0; width * height], vec![0; width * height]];
        Ok(Self { inner, tables, rig: file.rectification.rig, raw, path })
    }
}

impl PairSource for RectifiedSource {
    fn size(&self) -> (usize, usize) {
        self.inner.size()
    }

    fn rig(&self) -> Option<Rig> {
        Some(self.rig)
    }

    fn geometry(&self) -> Geometry {
        Geometry::Rectified
    }

    fn notes(&self) -> Vec<String> {
        self.inner.notes()
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
        self.inner.vehicle(index)
    }

    fn live(&mut self) -> Option<&mut dyn LiveSource> {
        self.inner.live()
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        let [raw_left, raw_right] = &mut self.raw;
        self.inner.read(index, raw_left, raw_right)?;
        let (width, height) = self.inner.size();
        let fail = |reason: String| SourceError::Calibration { path: self.path.clone(), reason };
        for ((table, raw), out) in self.tables.iter().zip(&self.raw).zip([left, right]) {
            let view = GreyView::new(raw, width, height, width).map_err(|e| fail(e.to_string()))?;
            table.apply(view, out).map_err(|e| fail(e.to_string()))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector2, Vector3};
    use perception::calibration::{Camera, Crop, Distortion, Pose};

    /// A source with a brightness gradient in each image.
    struct Slope;

    impl PairSource for Slope {
        fn size(&self) -> (usize, usize) {
            (64, 48)
        }
        fn rig(&self) -> Option<Rig> {
            None
        }
        fn count(&self) -> Option<u64> {
            Some(1)
        }
        fn period_ns(&self) -> u64 {
            1
        }
        fn read(&mut self, _: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
            for (i, (l, r)) in left.iter_mut().zip(right).enumerate() {
                (*l, *r) = ((2 * (i % 64)) as u8, (4 * (i / 64)) as u8);
            }
            Ok(())
        }
    }

    #[test]
    fn every_pixel_shows_what_the_rig_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let camera = Camera {
            distortion: Distortion::BrownConrady([-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(60.0, 60.0, 31.0, 24.0)
        };
        let between = Pose {
            rotation: Rotation3::new(Vector3::new(0.02, 0.01, 0.03)),
            translation_m: Vector3::new(-0.1, 0.0, 0.0),
        };
        let rig = RigFile::from_cameras([camera; 2], between, (64, 48), Crop::Valid).unwrap();
        rig.write(&path).unwrap();
        let mut source = RectifiedSource::new(Box::new(Slope), &rig, path.clone()).unwrap();
        assert_eq!(source.rig(), Some(rig.rectification.rig));
        let (mut left, mut right) = (vec![0; 64 * 48], vec![0; 64 * 48]);
        source.read(0, &mut left, &mut right).unwrap();
        for (x, y) in [(10, 10), (32, 24), (50, 40), (5, 30)] {
            let place = Vector2::new(x as f64, y as f64);
            let from = |side| rig.rectification.source(&rig.cameras, side, place).unwrap();
            assert!((f64::from(left[y * 64 + x]) - 2.0 * from(0).x).abs() < 1.0);
            assert!((f64::from(right[y * 64 + x]) - 4.0 * from(1).y).abs() < 1.0);
        }
        let rig = RigFile::from_cameras([camera; 2], between, (80, 48), Crop::Valid).unwrap();
        rig.write(&path).unwrap();
        let error = RectifiedSource::new(Box::new(Slope), &rig, path).err().unwrap().to_string();
        assert!(error.contains("80x48"), "{error}");
    }
}
