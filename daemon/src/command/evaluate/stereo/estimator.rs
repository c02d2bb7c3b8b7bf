//! Where the disparity maps to be scored come from: the matcher, or files.

use crate::command::disparity::median;
use crate::command::error::CommandError;
use crate::stages::stereo::matcher::{Backend, Method};
use config::Config;
use perception::image::GreyView;
use perception::simd::Level;
use perception::stereo::epipolar::field::RowField;
use perception::stereo::epipolar::single_pair;
use perception::stereo::{MatchOutput, Matcher};
use sources::truth::{TruthError, TruthPair, map_file};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A pair in memory.
pub struct Images {
    pub left: Vec<u8>,
    pub right: Vec<u8>,
    pub width: usize,
    pub height: usize,
}

/// The disparity map to score.
pub struct Estimate {
    pub disparity: Vec<u16>,
    /// `None` for a map from a file.
    pub confidence: Option<Vec<u8>>,
    pub cpu_ms: Option<f64>,
}

/// Source of disparity maps.
pub trait Estimator {
    /// Corrects the rows of the right image by the pair's own matches; `None` where too few tell of them.
    fn correct_rows(
        &mut self,
        pair: &TruthPair,
        images: &mut Images,
    ) -> Result<Option<RowField>, CommandError>;

    /// The map of a pair; `None` to skip it.
    fn estimate(
        &mut self,
        set: &str,
        pair: &TruthPair,
        images: &Images,
    ) -> Result<Option<Estimate>, CommandError>;

    /// Memory of the largest matcher; `None` without one.
    fn workspace_bytes(&self) -> Option<usize>;
}

/// Computes disparity maps, with one matcher for each image size.
pub struct Matchers<'a> {
    pub config: &'a Config,
    pub method: Method,
    pub backend: Backend,
    pub disparities: usize,
    /// Runs per pair; the time is the median.
    pub repeat: u32,
    pub of_size: HashMap<(usize, usize), Box<dyn Matcher>>,
}

impl Matchers<'_> {
    /// The matcher for a pair's size.
    fn matcher(&mut self, pair: &TruthPair, images: &Images) -> Result<&mut dyn Matcher, CommandError> {
        let (width, height) = (images.width, images.height);
        let matcher = match self.of_size.entry((width, height)) {
            std::collections::hash_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::hash_map::Entry::Vacant(entry) => {
                let matcher = self
                    .method
                    .matcher(self.backend, self.config, width, height, self.disparities)
                    .map_err(|error| CommandError::Other(format!("{}: {error}", pair.left.display())))?;
                entry.insert(matcher)
            }
        };
        Ok(&mut **matcher)
    }
}

impl Estimator for Matchers<'_> {
    fn correct_rows(
        &mut self,
        pair: &TruthPair,
        images: &mut Images,
    ) -> Result<Option<RowField>, CommandError> {
        let matcher = self.matcher(pair, images)?;
        let (width, height) = (images.width, images.height);
        let left = GreyView::new(&images.left, width, height, width)?;
        let right = GreyView::new(&images.right, width, height, width)?;
        let corrected = single_pair::corrected(Level::best(), matcher, left, right)?;
        Ok(corrected.map(|(field, image)| {
            images.right.copy_from_slice(image.as_slice());
            field
        }))
    }

    fn estimate(
        &mut self,
        _set: &str,
        pair: &TruthPair,
        images: &Images,
    ) -> Result<Option<Estimate>, CommandError> {
        let repeat = self.repeat;
        let matcher = self.matcher(pair, images)?;
        let (width, height) = (images.width, images.height);
        let left = GreyView::new(&images.left, width, height, width)?;
        let right = GreyView::new(&images.right, width, height, width)?;
        let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
        let mut cpu_ms = Vec::new();
        for _ in 0..repeat {
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            let start = messages::clock::process_cpu_ns();
            matcher.compute(left, right, output)?;
            cpu_ms.push((messages::clock::process_cpu_ns() - start) as f64 * 1e-6);
        }
        let cpu_ms = Some(tools::reporting::record::tidy(median(&mut cpu_ms)));
        Ok(Some(Estimate { disparity, confidence: Some(confidence), cpu_ms }))
    }

    fn workspace_bytes(&self) -> Option<usize> {
        self.of_size.values().map(|matcher| matcher.workspace_bytes()).max()
    }
}

/// Reads disparity maps from files.
pub struct Maps<'a> {
    pub folder: &'a Path,
}

/// Possible paths of a pair's map; the second is where `--out` writes it.
pub fn map_paths(folder: &Path, set: &str, pair: &str) -> [PathBuf; 3] {
    let file = format!("{pair}.png");
    [folder.join(set).join(&file), folder.join(set).join("disparity").join(&file), folder.join(&file)]
}

impl Estimator for Maps<'_> {
    fn correct_rows(&mut self, _: &TruthPair, _: &mut Images) -> Result<Option<RowField>, CommandError> {
        Ok(None)
    }

    fn estimate(
        &mut self,
        set: &str,
        pair: &TruthPair,
        images: &Images,
    ) -> Result<Option<Estimate>, CommandError> {
        let Some(path) = map_paths(self.folder, set, &pair.name).into_iter().find(|path| path.is_file())
        else {
            return Ok(None);
        };
        let (disparity, width, height) = map_file::read_estimate(&path)?;
        let expected = (images.width, images.height);
        if (width, height) != expected {
            let size = (width, height);
            return Err(TruthError::Size { path, size, other: pair.left.clone(), expected }.into());
        }
        Ok(Some(Estimate { disparity, confidence: None, cpu_ms: None }))
    }

    fn workspace_bytes(&self) -> Option<usize> {
        None
    }
}
