//! Reads whole files up to a limit: a file that is too large is refused before memory is spent on it.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;
use thiserror::Error;

/// The limit of a kind of file.
#[derive(Clone, Copy, Debug)]
pub struct FileLimit {
    /// What the file holds: "a scene".
    pub what: &'static str,
    /// Maximum size, in bytes.
    pub bytes: u64,
    /// What to give instead.
    pub remedy: &'static str,
}

/// A file that is larger than its kind.
#[derive(Clone, Copy, Debug, Error)]
#[error(
    "{}{bytes} bytes: {} has at most {}; {}",
    if *is_whole { "" } else { "at least " }, limit.what, limit.bytes, limit.remedy
)]
pub struct TooLarge {
    limit: FileLimit,
    bytes: u64,
    /// Whether `bytes` is the whole size.
    is_whole: bool,
}

impl FileLimit {
    /// Checks a size.
    ///
    /// # Errors
    /// When it is beyond the limit, as [`TooLarge`].
    pub fn check(&self, bytes: u64) -> Result<()> {
        self.fault(bytes, true)
    }

    fn fault(&self, bytes: u64, is_whole: bool) -> Result<()> {
        if bytes <= self.bytes {
            return Ok(());
        }
        Err(Error::new(ErrorKind::FileTooLarge, TooLarge { limit: *self, bytes, is_whole }))
    }
}

/// Reads a file. One that does not say its size, such as a pipe, is read to the limit.
///
/// # Errors
/// When it cannot be read, or is too large, as [`TooLarge`].
pub fn read(path: &Path, limit: &FileLimit) -> Result<Vec<u8>> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    limit.check(size)?;
    let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
    file.take(limit.bytes + 1).read_to_end(&mut bytes)?;
    limit.fault(bytes.len() as u64, false)?;
    Ok(bytes)
}

/// Reads a file of UTF-8 text, as [`read`].
///
/// # Errors
/// As [`read`], and when it is no text.
pub fn read_text(path: &Path, limit: &FileLimit) -> Result<String> {
    String::from_utf8(read(path, limit)?)
        .map_err(|_| Error::new(ErrorKind::InvalidData, "the file is not text in UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: FileLimit = FileLimit { what: "a test", bytes: 4, remedy: "give less" };

    #[test]
    fn a_file_beyond_the_limit_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse");
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        let error = read(&path, &LIMIT).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert_eq!(error.to_string(), "1099511627776 bytes: a test has at most 4; give less");
        // A file that does not say its size.
        let error = read(Path::new("/dev/zero"), &LIMIT).unwrap_err().to_string();
        assert_eq!(error, "at least 5 bytes: a test has at most 4; give less");
        std::fs::write(&path, "four").unwrap();
        assert_eq!(read_text(&path, &LIMIT).unwrap(), "four");
        std::fs::write(&path, [0xff]).unwrap();
        assert!(read_text(&path, &LIMIT).unwrap_err().to_string().contains("UTF-8"));
    }
}
