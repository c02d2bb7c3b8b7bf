//! The node counter of iceoryx2, a file in /dev/shm that it would open to every user.
//!
//! iceoryx2 numbers the nodes of a domain with a counter in a file of its own, which it creates with mode 0666. A user
//! who truncates it makes every later node creation, and the cleanup of dead nodes, wait forever. iceoryx2 uses an
//! existing file as it is, so the run creates it first, with mode 0600.

use crate::run_files::{RunPrefix, create_own, is_own_file};
use std::io::{self, Write};
use std::path::PathBuf;

/// Name of the file after the prefix, in iceoryx2 0.10.0: SHA-1 of the type's name, and the version.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";

/// Version 0.10.0 as iceoryx2 encodes it: major, minor and patch, 16 bits each. It marks the file as initialised.
const VERSION: u64 = 10 << 16;

/// Number of bytes of the file: the version, the counter (32 bits), and padding.
const BYTES: usize = 16;

/// Whether the run of `prefix` still has the file. A process that joined without it would create it, open to everybody.
pub(crate) fn exists(prefix: &RunPrefix) -> bool {
    std::fs::symlink_metadata(prefix.path(NAME)).is_ok_and(|m| is_own_file(&m))
}

/// Creates the file for the run of `prefix`.
///
/// # Errors
/// The file, and why it cannot be created.
pub(crate) fn create(prefix: &RunPrefix) -> Result<(), (PathBuf, io::Error)> {
    let path = prefix.path(NAME);
    let mut content = [0; BYTES];
    content[..size_of_val(&VERSION)].copy_from_slice(&VERSION.to_ne_bytes());
    create_own(&path).and_then(|mut file| file.write_all(&content)).map_err(|error| (path, error))
}
