//! Checkpoints of a training run, to resume it after an interruption.

use super::error::TrainError;
use super::parameters::TrainParameters;
use super::pictures::Split;
use super::trainer::StageFigures;
use perception::recognition::Cascade;
use perception::recognition::xml::{self, TrainedWith};
use serde::{Deserialize, Serialize};
use sources::bounded_file;
use sources::limits::CHECKPOINT;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A checkpoint file next to the output file of the cascade.
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    /// Hash of the parameters and all images: with others the result would differ.
    fingerprint: String,
}

/// Progress of an interrupted run.
#[derive(Clone, Debug, Default)]
pub struct Begun {
    /// One per bag; the last may be incomplete.
    pub cascades: Vec<Cascade>,
    /// Statistics of all their stages.
    pub figures: Vec<StageFigures>,
}

#[derive(Serialize, Deserialize)]
struct Document {
    fingerprint: String,
    figures: Vec<StageFigures>,
    /// One per bag; the last may be incomplete.
    cascades: Vec<String>,
}

/// 64-bit FNV-1a.
fn hash(state: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(state, |state, &b| (state ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

impl Checkpoint {
    /// The checkpoint of a cascade to be written to `output`.
    pub fn new(output: &Path, p: &TrainParameters, objects: &Split, rest: &Split) -> Self {
        let mut name = output.as_os_str().to_owned();
        name.push(".part");
        // The number of threads does not affect the result.
        let settings = format!("{:?}", TrainParameters { threads: 1, ..*p });
        let mut state = hash(0xcbf2_9ce4_8422_2325, settings.as_bytes());
        for split in [objects, rest] {
            for (mark, pictures) in [(b"t", &split.training), (b"v", &split.validation)] {
                state = hash(state, mark);
                for picture in pictures {
                    state = hash(state, picture.grey.as_slice());
                }
            }
        }
        let mut fingerprint = String::new();
        // Writing to a String cannot fail.
        let _ = write!(fingerprint, "{state:016x}");
        Self { path: name.into(), fingerprint }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The stages finished by an earlier run with the same parameters and images; `None` without a checkpoint.
    ///
    /// # Errors
    /// When the file is invalid, or belongs to other parameters or images.
    pub fn load(&self) -> Result<Option<Begun>, TrainError> {
        let text = match bounded_file::read_text(&self.path, &CHECKPOINT) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(TrainError::Data(format!("{}: {error}", self.path.display()))),
        };
        let wrong = |why: &str| {
            let path = self.path.display();
            TrainError::Data(format!("{path}: {why}: give --restart to start over, or another -o"))
        };
        let document: Document =
            serde_json::from_str(&text).map_err(|e| wrong(&format!("not a checkpoint: {e}")))?;
        if document.fingerprint != self.fingerprint {
            return Err(wrong("was started with other options or images"));
        }
        let cascades = document.cascades.iter().map(|text| xml::read(text));
        let cascades: Vec<Cascade> = cascades.collect::<Result<_, _>>().map_err(|e| wrong(&e.to_string()))?;
        if cascades.iter().map(|c| c.stages.len()).sum::<usize>() != document.figures.len() {
            return Err(wrong("stages and statistics do not agree"));
        }
        Ok(Some(Begun { cascades, figures: document.figures }))
    }

    /// Saves the stages so far atomically.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save(
        &self,
        cascades: &[Cascade],
        with: &TrainedWith,
        figures: &[StageFigures],
    ) -> Result<(), TrainError> {
        let document = Document {
            fingerprint: self.fingerprint.clone(),
            figures: figures.to_vec(),
            cascades: cascades.iter().map(|cascade| xml::write(cascade, with)).collect(),
        };
        let io = |error: &dyn std::fmt::Display| {
            TrainError::Data(format!("{}: {error}: give a writable path with -o", self.path.display()))
        };
        let text = serde_json::to_string(&document).map_err(|e| io(&e))?;
        let mut fresh = self.path.clone().into_os_string();
        fresh.push(".new");
        std::fs::write(&fresh, text).map_err(|e| io(&e))?;
        std::fs::rename(&fresh, &self.path).map_err(|e| io(&e))
    }

    /// Removes the file, when the cascade is finished or training starts over.
    ///
    /// # Errors
    /// When it exists and cannot be removed.
    pub fn remove(&self) -> Result<(), TrainError> {
        match std::fs::remove_file(&self.path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(TrainError::Data(format!("{}: {error}", self.path.display())))
            }
            _ => Ok(()),
        }
    }
}
