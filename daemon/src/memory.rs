//! Resident memory of this process.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

/// Resident memory, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Anonymous pages (`RssAnon`): heap and stacks.
    pub private_bytes: u64,
    /// Pages of mapped files (`RssFile`), mostly the program itself; shared between processes.
    pub file_bytes: u64,
    /// Pages of shared memory that this process has touched (`RssShmem`); others may map them, too.
    pub shared_bytes: u64,
}

/// Reads /proc/self/status through a file that stays open, without allocating.
#[derive(Debug)]
pub struct MemoryProbe {
    file: File,
}

impl MemoryProbe {
    /// Opens the probe.
    ///
    /// # Errors
    /// If `/proc/self/status` cannot be opened.
    pub fn open() -> io::Result<Self> {
        Ok(Self { file: File::open("/proc/self/status")? })
    }

    /// The memory now; `None` if the kernel does not report it.
    pub fn read(&self) -> Option<Memory> {
        let mut buffer = [0; 4096];
        let length = self.file.read_at(&mut buffer, 0).ok()?;
        parse(std::str::from_utf8(&buffer[..length]).ok()?)
    }
}

fn parse(status: &str) -> Option<Memory> {
    let bytes = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.split_ascii_whitespace().next()?.parse::<u64>().ok()? * 1024)
    };
    Some(Memory {
        private_bytes: bytes("RssAnon:")?,
        file_bytes: bytes("RssFile:")?,
        shared_bytes: bytes("RssShmem:")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proc_status_is_parsed() {
        let text = "Name:\tx\nVmRSS:\t 30 kB\nRssAnon:\t    12 kB\nRssFile:\t 8 kB\nRssShmem:\t 10 kB\n";
        assert_eq!(
            parse(text),
            Some(Memory { private_bytes: 12 * 1024, file_bytes: 8 * 1024, shared_bytes: 10 * 1024 })
        );
        assert_eq!(parse("RssAnon: x kB"), None);
        let own = MemoryProbe::open().unwrap().read().unwrap();
        assert!(own.private_bytes > 100_000, "{own:?}");
    }
}
