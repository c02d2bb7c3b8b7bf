//! One line of the report.

use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// How good a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As it should be.
    Good,
    /// It works, but something is missing that some uses need.
    Note,
    /// The daemon, or the configuration, cannot work so.
    Problem,
}

impl Level {
    fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Note => "note",
            Self::Problem => "problem",
        }
    }
}

/// What was found, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What it is about, such as `cameras`.
    pub area: &'static str,
    /// How good it is.
    pub level: Level,
    /// What was found.
    pub text: String,
    /// What to do; `None` if it is good.
    pub remedy: Option<String>,
}

impl Finding {
    /// As it should be.
    pub fn good(area: &'static str, text: impl Into<String>) -> Self {
        Self { area, level: Level::Good, text: text.into(), remedy: None }
    }

    /// Something that some uses need is missing.
    pub fn note(area: &'static str, text: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { area, level: Level::Note, text: text.into(), remedy: Some(remedy.into()) }
    }

    /// The daemon cannot work so.
    pub fn problem(area: &'static str, text: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { area, level: Level::Problem, text: text.into(), remedy: Some(remedy.into()) }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<12} {:<8} {}", self.area, self.level.name(), self.text)?;
        match &self.remedy {
            Some(remedy) => write!(f, "\n{:<21} -> {remedy}", ""),
            None => Ok(()),
        }
    }
}

/// The text of a file below `root`, trimmed; `None` if it cannot be read.
pub fn text(root: &Path, file: &str) -> Option<String> {
    std::fs::read_to_string(root.join(file)).ok().map(|text| text.trim().to_owned())
}

/// Entries of a folder below `root` whose names start with a text, sorted by the numbers in them.
pub fn entries(root: &Path, folder: &str, start: &str) -> Vec<PathBuf> {
    let read = std::fs::read_dir(root.join(folder));
    let mut found: Vec<(u64, String, PathBuf)> = read
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let number = name.strip_prefix(start)?.parse().unwrap_or(u64::MAX);
            Some((number, name, entry.path()))
        })
        .collect();
    found.sort();
    found.into_iter().map(|(.., path)| path).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_is_a_line_and_its_remedy_another() {
        let good = Finding::good("memory", "8.0 GiB").to_string();
        assert_eq!(good, "memory       good     8.0 GiB");
        let note = Finding::note("heat", "no sensor", "nothing to do").to_string();
        assert!(note.starts_with("heat         note     no sensor\n") && note.ends_with("-> nothing to do"));
        let json = serde_json::to_value(Finding::problem("cameras", "a", "b")).unwrap();
        assert_eq!((&json["level"], &json["remedy"]), (&"problem".into(), &"b".into()));
    }
}
