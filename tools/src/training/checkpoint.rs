//! What a training run needs to go on after it was stopped: the stages so far.

use super::error::TrainError;
use super::parameters::TrainParameters;
use super::pictures::Split;
use super::trainer::StageFigures;
use perception::recognition::Cascade;
use perception::recognition::xml::{self, TrainedWith};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The stages so far, beside the file that the cascade will be written to.
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    /// Of the parameters and all pictures: other ones make another cascade.
    fingerprint: String,
}

/// What an earlier run finished.
#[derive(Clone, Debug, Default)]
pub struct Begun {
    /// One a bag, the last of them perhaps with some of its stages only.
    pub cascades: Vec<Cascade>,
    /// Figures of all their stages.
    pub figures: Vec<StageFigures>,
}

#[derive(Serialize, Deserialize)]
struct Document {
    fingerprint: String,
    figures: Vec<StageFigures>,
    /// One a bag, the last of them perhaps with some of its stages only.
    cascades: Vec<String>,
}

/// FNV-1a, 64 bits.
fn hash(state: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(state, |state, &b| (state ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

impl Checkpoint {
    /// The checkpoint of a cascade that is to be written to `output`.
    pub fn new(output: &Path, p: &TrainParameters, objects: &Split, rest: &Split) -> Self {
        let mut name = output.as_os_str().to_owned();
        name.push(".part");
        // The number of threads changes nothing.
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

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The stages that an earlier run with the same parameters and pictures finished; `None` when
    /// there are none.
    ///
    /// # Errors
    /// When the file is not sound, or belongs to other parameters or pictures.
    pub fn load(&self) -> Result<Option<Begun>, TrainError> {
        let text = match std::fs::read_to_string(&self.path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(TrainError::Data(format!("{}: {error}", self.path.display()))),
        };
        let wrong = |why: &str| {
            let path = self.path.display();
            TrainError::Data(format!("{path}: {why}: give --restart to begin anew, or another -o"))
        };
        let document: Document =
            serde_json::from_str(&text).map_err(|e| wrong(&format!("not a checkpoint: {e}")))?;
        if document.fingerprint != self.fingerprint {
            return Err(wrong("was begun with other options or pictures"));
        }
        let cascades = document.cascades.iter().map(|text| xml::read(text));
        let cascades: Vec<Cascade> = cascades.collect::<Result<_, _>>().map_err(|e| wrong(&e.to_string()))?;
        if cascades.iter().map(|c| c.stages.len()).sum::<usize>() != document.figures.len() {
            return Err(wrong("stages and figures do not agree"));
        }
        Ok(Some(Begun { cascades, figures: document.figures }))
    }

    /// Keeps the stages so far, in one step: a run that is stopped here loses nothing.
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
            TrainError::Data(format!(
                "{}: {error}: give a place that can be written with -o",
                self.path.display()
            ))
        };
        let text = serde_json::to_string(&document).map_err(|e| io(&e))?;
        let mut fresh = self.path.clone().into_os_string();
        fresh.push(".new");
        std::fs::write(&fresh, text).map_err(|e| io(&e))?;
        std::fs::rename(&fresh, &self.path).map_err(|e| io(&e))
    }

    /// Removes the file: the cascade is done, or begins anew.
    ///
    /// # Errors
    /// When it is there and cannot be removed.
    pub fn remove(&self) -> Result<(), TrainError> {
        match std::fs::remove_file(&self.path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(TrainError::Data(format!("{}: {error}", self.path.display())))
            }
            _ => Ok(()),
        }
    }
}
