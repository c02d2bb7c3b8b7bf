//! Tests that cannot run on this machine. Each says what it needs and why it was skipped; `cargo test --workspace`
//! prints all of them in one list at its end.
//!
//! `LOOKOUT_REQUIRE` names needs, separated by commas, or is `all`: a test that would be skipped for one of them fails.
//! `LOOKOUT_SKIPPED` names a file to which several runs of `cargo test` append their lines.

use std::ffi::OsString;
use std::fs::OpenOptions;
use std::io::Write;
use std::panic::Location;
use std::path::{Path, PathBuf};

/// What a test needs beyond a Rust toolchain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// The shared data sets, in `../shared/data` beside the repository.
    Data,
    /// Chromium, for the viewer's page.
    Chromium,
    /// Python with the packages that the test names.
    Python,
    /// The libraries of GStreamer.
    GStreamer,
    /// A Vulkan adapter, in hardware or software.
    Gpu,
    /// A Vulkan adapter in software.
    SoftwareGpu,
    /// User and mount namespaces without further rights.
    Namespaces,
    /// The right to real-time priorities and locked memory.
    RealTime,
    /// SIGHUP that is not ignored.
    Hangup,
    /// The programs of systemd.
    Systemd,
    /// ffmpeg, for videos.
    Ffmpeg,
    /// A C compiler with pkg-config.
    Cc,
    /// The program openssl, for certificates.
    OpenSsl,
}

impl Need {
    /// Every need.
    pub const ALL: [Self; 13] = [
        Self::Data,
        Self::Chromium,
        Self::Python,
        Self::GStreamer,
        Self::Gpu,
        Self::SoftwareGpu,
        Self::Namespaces,
        Self::RealTime,
        Self::Hangup,
        Self::Systemd,
        Self::Ffmpeg,
        Self::Cc,
        Self::OpenSsl,
    ];

    /// Its name in `LOOKOUT_REQUIRE`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Chromium => "chromium",
            Self::Python => "python",
            Self::GStreamer => "gstreamer",
            Self::Gpu => "gpu",
            Self::SoftwareGpu => "software-gpu",
            Self::Namespaces => "namespaces",
            Self::RealTime => "realtime",
            Self::Hangup => "hangup",
            Self::Systemd => "systemd",
            Self::Ffmpeg => "ffmpeg",
            Self::Cc => "cc",
            Self::OpenSsl => "openssl",
        }
    }
}

/// Records that the calling test is skipped, or a part of it; the test returns after that.
///
/// # Panics
///
/// If `LOOKOUT_REQUIRE` names the need, or a need that does not exist.
#[track_caller]
pub fn skip(need: Need, why: &str) {
    let required = std::env::var("LOOKOUT_REQUIRE").unwrap_or_default();
    let is_required = is_required(&required, need).unwrap_or_else(|error| panic!("{error}"));
    assert!(!is_required, "LOOKOUT_REQUIRE={required} asks for \"{}\": {why}", need.name());
    let line = format!("skipped: {}: {why} [{}]\n", test_name(Location::caller()), need.name());
    // Not by `println!`, whose output libtest keeps to itself where a test passes.
    let _ = std::io::stderr().write_all(line.as_bytes());
    let path = record_path();
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).expect("the folder of the list can be made");
    }
    let mut file = OpenOptions::new().create(true).append(true).open(path).expect("the list can be opened");
    file.write_all(line.as_bytes()).expect("the list can be written");
}

/// The list of all tests that were skipped since it was last taken, which forgets them, unless `LOOKOUT_SKIPPED`
/// names the file.
pub fn take_list() -> String {
    let path = record_path();
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    if std::env::var_os("LOOKOUT_SKIPPED").is_none() {
        let _ = std::fs::remove_file(&path);
        remove_stale(path.parent().unwrap_or(Path::new("")));
    }
    list(&text)
}

/// The lines of a record, sorted, each once, below their number.
fn list(text: &str) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    lines.sort_unstable();
    lines.dedup();
    match lines.len() {
        0 => "no test was skipped\n".into(),
        n => format!("{n} skipped (LOOKOUT_REQUIRE=all makes these failures)\n{}\n", lines.join("\n")),
    }
}

/// Whether a value of `LOOKOUT_REQUIRE` names a need.
fn is_required(required: &str, need: Need) -> Result<bool, String> {
    let names: Vec<&str> = required.split(',').map(str::trim).filter(|name| !name.is_empty()).collect();
    let known = |name: &str| name == "all" || Need::ALL.iter().any(|need| need.name() == name);
    if let Some(unknown) = names.iter().find(|name| !known(name)) {
        let known: Vec<&str> = Need::ALL.iter().map(|need| need.name()).collect();
        return Err(format!("LOOKOUT_REQUIRE: \"{unknown}\" is none of all, {}", known.join(", ")));
    }
    Ok(names.iter().any(|&name| name == "all" || name == need.name()))
}

/// Program and test, as `cargo test` prints them.
fn test_name(caller: &Location) -> String {
    let program = std::env::current_exe().unwrap_or_default();
    let program = program.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    // Cargo appends a hash.
    let program = program.rsplit_once('-').map_or(program.as_str(), |(name, _)| name);
    match std::thread::current().name() {
        // libtest names a thread after its test, but runs tests in the main thread on a machine with one core.
        Some(name) if name != "main" => format!("{program} {name}"),
        _ => format!("{program} {}:{}", caller.file(), caller.line()),
    }
}

/// The file with the lines of this run. `cargo test` is the parent of every test program that it runs, so its process
/// id tells which lines belong together.
fn record_path() -> PathBuf {
    match std::env::var_os("LOOKOUT_SKIPPED") {
        Some(path) => path.into(),
        None => folder().join(std::os::unix::process::parent_id().to_string()),
    }
}

/// `target/release/skipped-tests`: programs lie in `target/release/deps`.
fn folder() -> PathBuf {
    let program = std::env::current_exe().expect("a program has a path");
    program.ancestors().nth(2).expect("Cargo's folder").join("skipped-tests")
}

/// Removes records of runs that have ended without their list.
fn remove_stale(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let has_ended = |id: OsString| !Path::new("/proc").join(id).exists();
    for entry in entries.flatten().filter(|entry| has_ended(entry.file_name())) {
        let _ = std::fs::remove_file(entry.path());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needs_are_required_by_name_or_all_at_once() {
        assert_eq!(is_required("", Need::Data), Ok(false));
        assert_eq!(is_required("gpu, data", Need::Data), Ok(true));
        assert_eq!(is_required("gpu,chromium", Need::Data), Ok(false));
        assert!(Need::ALL.iter().all(|&need| is_required("all", need) == Ok(true)));
        assert!(Need::ALL.iter().all(|&need| is_required(need.name(), need) == Ok(true)));
        let error = is_required("data,chrome", Need::Data).expect_err("a typing error");
        assert!(error.contains("\"chrome\"") && error.contains("chromium"), "{error}");
    }

    #[test]
    fn the_list_is_sorted_and_names_each_test_once() {
        assert_eq!(list(""), "no test was skipped\n");
        let text = list("skipped: b: why [gpu]\nskipped: a: why [data]\nskipped: b: why [gpu]\n");
        assert!(text.starts_with("2 skipped"), "{text}");
        assert!(text.ends_with("\nskipped: a: why [data]\nskipped: b: why [gpu]\n"), "{text}");
    }
}
