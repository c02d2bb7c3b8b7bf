//! What calibration files hold.

use super::RigFile;
use perception::rig::Rig;

/// What a calibration file holds.
#[derive(Clone, Debug)]
pub enum Calibration {
    /// A pair that is rectified already.
    Rectified {
        /// Its rig.
        rig: Rig,
        /// Width and height of its pictures, if the file says them.
        size: Option<(usize, usize)>,
    },
    /// The cameras of pictures that are not, with the rig after rectification.
    Cameras(Box<RigFile>),
}

impl Calibration {
    /// The rig of the rectified pair.
    pub fn rig(&self) -> Rig {
        match self {
            Self::Rectified { rig, .. } => *rig,
            Self::Cameras(file) => file.rectification.rig,
        }
    }

    /// Whether nothing says the size of the pictures that it is for.
    pub fn is_without_size(&self) -> bool {
        matches!(self, Self::Rectified { size: None, .. })
    }

    /// The same as [`Self::rig`], for pictures of a size.
    ///
    /// # Errors
    /// If the file says that it is for pictures of another size.
    pub fn rig_for(&self, size: (usize, usize)) -> Result<Rig, String> {
        match self {
            Self::Rectified { rig, .. } => Ok(*rig),
            Self::Cameras(file) => file.check_size(size).map(|()| file.rectification.rig),
        }
    }
}
