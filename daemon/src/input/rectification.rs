//! Whether the pictures of a source are rectified, and with which rig.

use super::error::InputError;
use super::name;
use config::Config;
use config::automatic::Automatic;
use sources::calibration_file::{self, Calibration};
use sources::rectified::RectifiedSource;
use sources::{Geometry, PairSource, SourceError};
use std::path::{Path, PathBuf};

/// Largest distance by which a rig may move pixels if its pictures count as rectified, in px: a step of the remapping.
const MAX_RECTIFIED_PX: f64 = 1.0 / 32.0;

/// The source with rectified pictures, as `source.rectify` says.
///
/// # Errors
/// If a rig file cannot be read or is for pictures of another size, or if pictures would have to be rectified and cannot.
pub fn rectified(config: &Config, source: Box<dyn PairSource>) -> Result<Box<dyn PairSource>, InputError> {
    let rig = &config.source.rig;
    let read = |path: &Path| {
        let file = calibration_file::open_for(path, source.has_colour_cameras(), source.size());
        file.map_err(|error| if rig.as_os_str().is_empty() { error.into() } else { InputError::Rig(error) })
    };
    let path =
        if rig.as_os_str().is_empty() { source.rig_file().map(PathBuf::from) } else { Some(rig.clone()) };
    if config.source.rectify == Automatic::On {
        let path = path.ok_or(InputError::NoCameras)?;
        return match read(&path)? {
            Calibration::Cameras(file) => Ok(Box::new(RectifiedSource::new(source, &file, path)?)),
            Calibration::Rectified { .. } => Err(InputError::NoDistortion(path)),
        };
    }
    let calibration = path.as_deref().map(read).transpose()?;
    let Some((path, Calibration::Cameras(file))) = path.zip(calibration) else {
        let is_refused = config.source.rectify == Automatic::Auto && source.geometry() == Geometry::Distorted;
        return if is_refused { Err(InputError::Distorted(name(config))) } else { Ok(source) };
    };
    file.check_size(source.size())
        .map_err(|reason| SourceError::Calibration { path: path.clone(), reason })?;
    let is_rectified =
        source.geometry() == Geometry::Rectified || file.rectification_px() <= MAX_RECTIFIED_PX;
    if config.source.rectify == Automatic::Off || is_rectified {
        return Ok(source);
    }
    tracing::info!(rig = %path.display(), "pictures are rectified; source.rectify = false takes them as they are");
    Ok(Box::new(RectifiedSource::new(source, &file, path)?))
}

/// Tells if the rig that is named, one of rectified pictures, stands in for cameras beside the pictures that would rectify
/// them.
pub fn tell_cameras_beside(config: &Config, source: &dyn PairSource) {
    let named = &config.source.rig;
    if config.source.rectify == Automatic::Auto
        && source.geometry() != Geometry::Rectified
        && let Some(beside) = source.rig_file()
        && let Ok(Calibration::Cameras(file)) =
            calibration_file::open_for(beside, source.has_colour_cameras(), source.size())
        && file.rectification_px() > MAX_RECTIFIED_PX
    {
        tracing::warn!(
            "{}: it is for rectified pictures, but by {} beside them these are not: they are taken as they are; leave out \
             --rig (source.rig) to rectify them, or set source.rectify = false if they are rectified",
            named.display(),
            beside.display()
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};
    use perception::calibration::{Camera, Crop, Distortion, Pose};
    use perception::rig::Rig;
    use sources::rig_file::RigFile;

    /// A source with brightness that grows to the right.
    struct Slope(Geometry);

    const SIZE: (usize, usize) = (64, 48);
    const RIG: Rig = Rig { focal_px: 60.0, baseline_m: 0.1, cx_px: 31.0, cy_px: 24.0 };

    impl PairSource for Slope {
        fn size(&self) -> (usize, usize) {
            SIZE
        }
        fn rig(&self) -> Option<Rig> {
            (self.0 != Geometry::Unknown).then_some(RIG)
        }
        fn geometry(&self) -> Geometry {
            self.0
        }
        fn count(&self) -> Option<u64> {
            Some(1)
        }
        fn period_ns(&self) -> u64 {
            1
        }
        fn read(&mut self, _: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
            for (i, (l, r)) in left.iter_mut().zip(right).enumerate() {
                (*l, *r) = ((3 * (i % SIZE.0)) as u8, 7);
            }
            Ok(())
        }
    }

    fn write_rig(path: &Path, distortion: f64, size: (usize, usize)) {
        let camera = Camera {
            distortion: Distortion::BrownConrady([distortion, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(RIG.focal_px, RIG.focal_px, RIG.cx_px, RIG.cy_px)
        };
        let between =
            Pose { rotation: Rotation3::identity(), translation_m: Vector3::new(-RIG.baseline_m, 0.0, 0.0) };
        let mut file = RigFile::from_cameras([camera; 2], between, size, Crop::Valid).unwrap();
        if distortion == 0.0 {
            file.rectification.rig = RIG;
        }
        file.write(path).unwrap();
    }

    /// Whether the pictures of a source come out changed.
    fn changes(config: &Config, geometry: Geometry) -> Result<bool, String> {
        let mut source = rectified(config, Box::new(Slope(geometry))).map_err(|e| e.to_string())?;
        let ((mut left, mut right), mut raw) = ((vec![0; 64 * 48], vec![0; 64 * 48]), vec![0; 64 * 48]);
        source.read(0, &mut left, &mut right).map_err(|e| e.to_string())?;
        Slope(geometry).read(0, &mut raw, &mut right).map_err(|e| e.to_string())?;
        Ok(left != raw)
    }

    #[test]
    fn a_rig_that_can_rectify_does_unless_the_pictures_are_rectified() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let mut config = Config::default();
        config.source.rig = path.clone();
        write_rig(&path, -0.2, SIZE);
        for (rectify, expected) in
            [(Automatic::Auto, [true, true, false]), (Automatic::On, [true; 3]), (Automatic::Off, [false; 3])]
        {
            config.source.rectify = rectify;
            let found = [Geometry::Unknown, Geometry::Distorted, Geometry::Rectified]
                .map(|geometry| changes(&config, geometry).unwrap());
            assert_eq!(found, expected, "{rectify:?}");
        }
        // Cameras without distortion that look the same way: nothing to do.
        config.source.rectify = Automatic::Auto;
        write_rig(&path, 0.0, SIZE);
        assert_eq!(changes(&config, Geometry::Unknown), Ok(false));
        // The rig of a rectified pair says that the pictures are.
        std::fs::write(&path, "focal_px = 60.0\nbaseline_m = 0.1\ncx_px = 31.0\ncy_px = 24.0\n").unwrap();
        assert_eq!(changes(&config, Geometry::Unknown), Ok(false));
    }

    #[test]
    fn what_does_not_fit_is_refused_with_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let mut config = Config::default();
        // Distorted pictures without a rig.
        let error = changes(&config, Geometry::Distorted).unwrap_err();
        assert!(error.contains("not rectified") && error.contains("--rig"), "{error}");
        config.source.rectify = Automatic::Off;
        assert_eq!(changes(&config, Geometry::Distorted), Ok(false));
        // A rig for another size, whatever is set.
        write_rig(&path, -0.2, (80, 48));
        config.source.rig = path;
        for rectify in [Automatic::Auto, Automatic::On, Automatic::Off] {
            config.source.rectify = rectify;
            for geometry in [Geometry::Unknown, Geometry::Rectified] {
                let error = changes(&config, geometry).unwrap_err();
                assert!(error.contains("80x48") && error.contains("64x48"), "{error}");
            }
        }
    }
}
