//! What a client reads.

use std::path::PathBuf;

/// Name of a daemon whose configuration gives it no other.
const DEFAULT_INSTANCE: &str = "lookout";

/// Maximum length of the name of a daemon, as in its configuration.
const MAX_NAME: usize = 16;

/// What a client reads. The default is the daemon `lookout`, without pictures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Name of the daemon, `instance.name` of its configuration.
    pub instance: String,
    /// Its folder, `instance.directory`. If empty: `$RUNTIME_DIRECTORY`, `/tmp/lookout-<user id>`, or the folder of the
    /// systemd service.
    pub directory: PathBuf,
    /// Whether frames come with the disparity map and its pictures. A frame is given only with its own, so it may come one
    /// frame later than without.
    pub pictures: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { instance: DEFAULT_INSTANCE.into(), directory: PathBuf::new(), pictures: false }
    }
}

impl Options {
    /// Whether the name is one that a daemon can have.
    pub(crate) fn has_valid_name(&self) -> bool {
        (1..=MAX_NAME).contains(&self.instance.len())
            && self.instance.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
    }
}
