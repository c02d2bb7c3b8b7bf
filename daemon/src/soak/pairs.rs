//! Pairs of a scene, drawn to files before the soak. Drawing a pair takes longer than processing it, and a
//! camera has no such cost, so drawing during the run would distort the measurement.

use super::error::SoakError;
use crate::input;
use config::Config;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Number of pairs that are drawn and then looped; at 640×480 they take 61 MB of disk.
pub const COUNT: u64 = 100;

/// A folder of pairs, removed on drop.
#[derive(Debug)]
pub struct DrawnPairs {
    /// Path of the folder.
    pub folder: PathBuf,
}

impl DrawnPairs {
    /// Draws the first [`COUNT`] pairs of the configured scene into `folder`, which must be new.
    pub fn draw(config: &Config, folder: PathBuf) -> Result<Self, SoakError> {
        let mut source = input::open(config).map_err(|e| SoakError::Config(e.to_string()))?;
        let rig = input::rig(config, source.as_ref()).map_err(|e| SoakError::Config(e.to_string()))?;
        let (width, height) = source.size();
        // Must be new, because it is removed with its contents on drop.
        let parent = folder.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(parent).map_err(SoakError::io(parent))?;
        std::fs::create_dir(&folder).map_err(SoakError::io(&folder))?;
        let pairs = Self { folder };
        for side in ["left", "right"] {
            let path = pairs.folder.join(side);
            std::fs::create_dir(&path).map_err(SoakError::io(&path))?;
        }
        let text = format!(
            "focal_px = {:?}\nbaseline_m = {:?}\ncx_px = {:?}\ncy_px = {:?}\n",
            rig.focal_px, rig.baseline_m, rig.cx_px, rig.cy_px
        );
        let path = pairs.folder.join("rig.toml");
        std::fs::write(&path, text).map_err(SoakError::io(&path))?;
        let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
        for index in 0..source.count().map_or(COUNT, |count| count.min(COUNT)) {
            source.read(index, &mut left, &mut right).map_err(|e| SoakError::Config(e.to_string()))?;
            for (side, pixels) in [("left", &left), ("right", &right)] {
                let path = pairs.folder.join(side).join(format!("{index:06}.pgm"));
                save(&path, pixels, width, height).map_err(SoakError::io(&path))?;
            }
        }
        Ok(pairs)
    }
}

impl Drop for DrawnPairs {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Writes a binary PGM, the format that is fastest to read.
fn save(path: &Path, pixels: &[u8], width: usize, height: usize) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    write!(file, "P5\n{width} {height}\n255\n")?;
    file.write_all(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sources::PairSource;
    use sources::folder::FolderSource;

    #[test]
    fn drawn_pairs_equal_the_scene_and_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = config::load(None).unwrap();
        config.source.kind = "scene".into();
        config.source.fps = 12.5;
        let pairs = DrawnPairs::draw(&config, folder.path().join("pairs")).unwrap();
        let mut drawn = FolderSource::open(&pairs.folder).unwrap();
        let mut scene = input::open(&config).unwrap();
        assert_eq!((drawn.count(), drawn.size(), drawn.rig()), (Some(COUNT), scene.size(), scene.rig()));
        let size = scene.size().0 * scene.size().1;
        let image = || vec![0; size];
        let (mut left, mut right, mut scene_left, mut scene_right) = (image(), image(), image(), image());
        drawn.read(7, &mut left, &mut right).unwrap();
        scene.read(7, &mut scene_left, &mut scene_right).unwrap();
        assert!(left == scene_left && right == scene_right);
        let path = pairs.folder.clone();
        drop(pairs);
        assert!(!path.exists());
    }
}
