//! Patterns of file names: `*` for any characters, `?` for one, in each part of a path.

use crate::SourceError;
use crate::limits::MAX_IMAGES;
use std::path::{Component, Path, PathBuf};

/// Stars in one part of a path. Each multiplies the time of a comparison by the length of a name.
const MAX_STARS: usize = 2;

/// A file that a pattern matches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Match {
    /// The file.
    pub path: PathBuf,
    /// What the wildcards stand for, separated by `/`.
    pub captured: String,
}

/// Whether a text has wildcards.
pub fn is_pattern(text: &str) -> bool {
    text.contains(['*', '?'])
}

/// The folder that contains everything that a pattern may match.
pub fn fixed_folder(pattern: &Path) -> PathBuf {
    let fixed = |part: &Component<'_>| !is_pattern(&part.as_os_str().to_string_lossy());
    let folder: PathBuf = pattern.components().take_while(fixed).collect();
    if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder }
}

/// The files that a pattern matches, in no order.
///
/// # Errors
/// If the pattern has too many stars, a folder cannot be read, or there are more than [`MAX_IMAGES`].
pub fn expand(pattern: &Path) -> Result<Vec<Match>, SourceError> {
    let mut found = vec![Match { path: PathBuf::new(), captured: String::new() }];
    for part in pattern.components() {
        let text = part.as_os_str().to_string_lossy();
        if !is_pattern(&text) {
            found.iter_mut().for_each(|one| one.path.push(part));
            continue;
        }
        if text.matches('*').count() > MAX_STARS {
            return Err(SourceError::Pattern {
                pattern: pattern.to_owned(),
                reason: format!("more than {MAX_STARS} stars between two slashes: use fewer"),
            });
        }
        let mut next = Vec::new();
        for one in found {
            list(&one, &text, &mut next)?;
            if next.len() > MAX_IMAGES {
                return Err(SourceError::TooMany {
                    path: pattern.to_owned(),
                    what: "images",
                    limit: MAX_IMAGES,
                    remedy: "divide the recording into folders",
                });
            }
        }
        found = next;
    }
    found.retain(|one| one.path.is_file());
    Ok(found)
}

/// Adds what a folder holds that matches a part of a pattern. A path that is no folder holds nothing.
fn list(folder: &Match, part: &str, found: &mut Vec<Match>) -> Result<(), SourceError> {
    let here = if folder.path.as_os_str().is_empty() { Path::new(".") } else { &folder.path };
    if !here.is_dir() {
        return Ok(());
    }
    let io = |source| SourceError::Io { path: here.to_owned(), source };
    let pattern: Vec<char> = part.chars().collect();
    for entry in std::fs::read_dir(here).map_err(io)? {
        let name = entry.map_err(io)?.file_name();
        let Some(text) = name.to_str().filter(|text| part.starts_with('.') || !text.starts_with('.')) else {
            continue;
        };
        let characters: Vec<char> = text.chars().collect();
        if let Some(captured) = capture(&pattern, &characters) {
            let captured = format!("{}/{captured}", folder.captured);
            found.push(Match { path: folder.path.join(&name), captured });
        }
    }
    Ok(())
}

/// What the wildcards of a pattern stand for in a name; `None` if it does not match.
fn capture(pattern: &[char], name: &[char]) -> Option<String> {
    match (pattern.first(), name.first()) {
        (None, None) => Some(String::new()),
        (Some('*'), _) => (0..=name.len()).find_map(|taken| {
            let rest = capture(&pattern[1..], &name[taken..])?;
            Some(format!("{}/{rest}", name[..taken].iter().collect::<String>()))
        }),
        (Some('?'), Some(&c)) => Some(format!("{c}/{}", capture(&pattern[1..], &name[1..])?)),
        (Some(p), Some(n)) if p == n => capture(&pattern[1..], &name[1..]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_stand_for_what_they_match() {
        for (pattern, name, expected) in [
            ("*.png", "7.png", Some("7/")),
            ("l*_?.png", "left_2.png", Some("eft/2/")),
            ("*a*", "bab", Some("b/b/")),
            ("*", "", Some("/")),
            ("?", "", None),
            ("?.png", "é.png", Some("é/")),
            ("a.png", "b.png", None),
            ("*.png", "7.jpg", None),
        ] {
            let [characters, of_name] = [pattern, name].map(|text| text.chars().collect::<Vec<char>>());
            assert_eq!(capture(&characters, &of_name).as_deref(), expected, "{pattern} {name}");
        }
    }

    #[test]
    fn a_pattern_may_have_wildcards_in_folders_too() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a/cam0/1.png", "a/cam0/2.png", "b/cam0/1.png", "a/cam1/1.png", "a/cam0/.hidden.png"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let mut found = expand(&folder.path().join("*/cam0/*.png")).unwrap();
        found.sort_by(|a, b| a.captured.cmp(&b.captured));
        let captured: Vec<&str> = found.iter().map(|one| &one.captured[..]).collect();
        assert_eq!(captured, ["/a//1/", "/a//2/", "/b//1/"]);
        assert!(expand(&folder.path().join("c*/1.png")).unwrap().is_empty());
        let error = expand(Path::new("*a*b*c/1.png")).unwrap_err().to_string();
        assert!(error.contains("*a*b*c/1.png") && error.contains("use fewer"), "{error}");
        assert_eq!(fixed_folder(Path::new("/x/y/*.png")), Path::new("/x/y"));
        assert_eq!(fixed_folder(Path::new("l*.png")), Path::new("."));
    }
}
