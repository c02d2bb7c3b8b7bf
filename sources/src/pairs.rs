//! Finds the left and the right pictures of a recording and pairs them by their names.

use crate::glob::{self, Match};
use crate::limits::MAX_IMAGES;
use crate::natural::natural;
use crate::picture::ENDINGS;
use crate::source::LAYOUTS;
use crate::{SourceError, foreign};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Entries of a folder that are examined for a hint.
const MAX_EXAMINED: usize = 1000;

/// Left and right picture. One of them may be missing.
pub type Pair = (PathBuf, PathBuf);

/// The pairs of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pairs {
    /// Pairs in natural order of their names.
    pub pairs: Vec<Pair>,
    /// Folders in which a calibration may lie, best first.
    pub calibration_folders: Vec<PathBuf>,
    /// Whether they were paired by their order, because their names have nothing in common.
    pub is_by_order: bool,
}

/// Image files of a folder, sorted by name.
///
/// # Errors
/// When the folder cannot be read, or has more than [`MAX_IMAGES`].
pub fn images(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let io = |source| SourceError::Io { path: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if is_picture(&path) {
            if found.len() == MAX_IMAGES {
                return Err(SourceError::TooMany {
                    path: folder.to_owned(),
                    what: "images",
                    limit: MAX_IMAGES,
                    remedy: "divide the recording into folders",
                });
            }
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    ending.is_some_and(|e| ENDINGS.contains(&e.as_str()))
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The side in a name ('l', 'r' or ' ') and the rest of the name, in lower case.
pub fn side(stem: &str) -> (char, String) {
    let lower = stem.to_ascii_lowercase();
    for (word, side) in [("left", 'l'), ("right", 'r')] {
        if let Some(at) = lower.find(word) {
            return (side, format!("{}{}", &lower[..at], &lower[at + word.len()..]));
        }
    }
    (' ', lower)
}

/// Finds the pairs of a folder: two folders named as in [`LAYOUTS`], or pictures with left and right in their names.
///
/// # Errors
/// If there is none; names what the folder holds instead.
pub fn find(path: &Path) -> Result<Pairs, SourceError> {
    if let Err(source) = std::fs::read_dir(path) {
        let explanation = if path.is_file() { foreign::explain(path) } else { None };
        return Err(match explanation {
            Some(explanation) => SourceError::Foreign { path: path.to_owned(), explanation },
            None if path.exists() && !path.is_dir() => SourceError::Foreign {
                path: path.to_owned(),
                explanation: "a file that is no recording: give a folder of pictures, or an MCAP file".into(),
            },
            None if !path.exists() => SourceError::Foreign {
                path: path.to_owned(),
                explanation:
                    "there is no such file or folder: give a folder of pictures, an MCAP file, or a scene as \
                              scene:NAME"
                        .into(),
            },
            None => SourceError::Io { path: path.to_owned(), source },
        });
    }
    let sides = LAYOUTS.iter().map(|(l, r)| (path.join(l), path.join(r)));
    let candidates: Vec<(PathBuf, PathBuf)> = sides.filter(|(l, r)| l.is_dir() && r.is_dir()).collect();
    for (left, right) in &candidates {
        let (lefts, rights) = (images(left)?, images(right)?);
        if lefts.is_empty() && rights.is_empty() {
            continue;
        }
        let empty = |folder: &Path| SourceError::Empty { path: folder.to_owned(), hint: hint(folder).0 };
        match (lefts.is_empty(), rights.is_empty()) {
            (true, _) => return Err(empty(left)),
            (_, true) => return Err(empty(right)),
            _ => {}
        }
        let parents = left.ancestors().skip(1).take_while(|folder| folder.starts_with(path));
        let mut calibration_folders: Vec<PathBuf> = parents.map(Path::to_owned).collect();
        // The folder that was named comes first.
        calibration_folders.reverse();
        let (pairs, is_by_order) = by_stem(&lefts, &rights)?;
        return Ok(Pairs { pairs, calibration_folders, is_by_order });
    }
    if let Some((left, _)) = candidates.first() {
        return Err(SourceError::Empty { path: left.clone(), hint: hint(left).0 });
    }
    let here = images(path)?;
    let of = |wanted: char| -> Vec<PathBuf> {
        here.iter().filter(|image| side(&stem(image)).0 == wanted).cloned().collect()
    };
    let (lefts, rights) = (of('l'), of('r'));
    if lefts.is_empty() || rights.is_empty() {
        let (hint, says_remedy) = hint(path);
        return Err(SourceError::Layout { path: path.to_owned(), hint, says_remedy });
    }
    let (pairs, is_by_order) = by_stem(&lefts, &rights)?;
    Ok(Pairs { pairs, calibration_folders: vec![path.to_owned()], is_by_order })
}

/// The pairs of two patterns: files, folders, or names with `*` and `?`. Files belong together whose wildcards stand for
/// the same text, else those with the same name but for left and right, else those at the same place in the order of
/// names, if there are as many of both.
///
/// # Errors
/// If a pattern matches no picture, or no left picture has a partner.
pub fn by_patterns(left: &Path, right: &Path) -> Result<Pairs, SourceError> {
    let lefts = matching(left)?;
    let rights = matching(right)?;
    let keyed = |found: &[Match]| found.iter().map(|one| (one.captured.clone(), one.path.clone())).collect();
    let (pairs, is_by_order) = match paired(keyed(&lefts), keyed(&rights)) {
        Some(pairs) => (pairs, false),
        None => {
            let paths = |found: &[Match]| found.iter().map(|one| one.path.clone()).collect::<Vec<_>>();
            by_stem(&paths(&lefts), &paths(&rights))?
        }
    };
    let (mut folder, other) = (glob::fixed_folder(left), glob::fixed_folder(right));
    if folder.is_file() {
        folder.pop();
    }
    let mut calibration_folders = vec![folder.clone()];
    // Left and right folders in one: the calibration lies there.
    if folder != other
        && let Some(parent) = folder.parent()
        && other.starts_with(parent)
    {
        calibration_folders.push(if parent.as_os_str().is_empty() { ".".into() } else { parent.to_owned() });
    }
    Ok(Pairs { pairs, calibration_folders, is_by_order })
}

/// The pictures that a pattern matches.
fn matching(pattern: &Path) -> Result<Vec<Match>, SourceError> {
    let fail = |reason: &str| SourceError::Pattern { pattern: pattern.to_owned(), reason: reason.to_owned() };
    let found = if pattern.is_dir() {
        let of = |path: PathBuf| Match { captured: stem(&path), path };
        images(pattern)?.into_iter().map(of).collect()
    } else {
        let mut found = glob::expand(pattern)?;
        if found.is_empty() && !glob::is_pattern(&pattern.to_string_lossy()) {
            return Err(fail("no such file or folder: give a folder, or a pattern such as 'cam0/*.png'"));
        }
        if !found.is_empty() {
            found.retain(|one| is_picture(&one.path));
            if found.is_empty() {
                return Err(fail("matches files, but no pictures (PNG, JPEG, TIFF, BMP, WebP, PGM, PPM)"));
            }
        }
        found
    };
    if found.is_empty() {
        return Err(fail("matches no picture: check the folder, and put the pattern in quotes"));
    }
    Ok(found)
}

/// Pairs pictures by their names, else by their names without left and right, else by their order; whether by order.
fn by_stem(lefts: &[PathBuf], rights: &[PathBuf]) -> Result<(Vec<Pair>, bool), SourceError> {
    let keyed = |images: &[PathBuf], key: &dyn Fn(&str) -> String| -> Vec<(String, PathBuf)> {
        images.iter().map(|image| (key(&stem(image)), image.clone())).collect()
    };
    let keys: [&dyn Fn(&str) -> String; 2] = [&|stem| stem.to_owned(), &|stem| side(stem).1];
    for key in keys {
        if let Some(pairs) = paired(keyed(lefts, key), keyed(rights, key)) {
            return Ok((pairs, false));
        }
    }
    if lefts.len() != rights.len() {
        let [left, right] = [lefts, rights].map(|images| images.first().cloned().unwrap_or_default());
        return Err(SourceError::NoPartners { left, lefts: lefts.len(), right, rights: rights.len() });
    }
    let sorted = |images: &[PathBuf]| {
        let mut images = images.to_vec();
        images.sort_by(|a, b| natural(&stem(a), &stem(b)));
        images
    };
    Ok((sorted(lefts).into_iter().zip(sorted(rights)).collect(), true))
}

/// Pairs pictures by their keys, in natural order of these; `None` if no key is on both sides. A picture without partner
/// gets the name that its partner would have.
fn paired(lefts: Vec<(String, PathBuf)>, rights: Vec<(String, PathBuf)>) -> Option<Vec<Pair>> {
    let [lefts, rights] = [lefts, rights].map(|side| side.into_iter().collect::<BTreeMap<_, _>>());
    let example = lefts.iter().find_map(|(key, left)| Some((left.clone(), rights.get(key)?.clone())))?;
    let mut keys: Vec<&String> =
        lefts.keys().chain(rights.keys()).collect::<BTreeSet<_>>().into_iter().collect();
    keys.sort_by(|a, b| natural(a, b));
    let pair = |key: &String| match (lefts.get(key), rights.get(key)) {
        (Some(left), Some(right)) => (left.clone(), right.clone()),
        (Some(left), None) => (left.clone(), partner(left, &example.0, &example.1)),
        (None, Some(right)) => (partner(right, &example.1, &example.0), right.clone()),
        (None, None) => example.clone(),
    };
    Some(keys.into_iter().map(pair).collect())
}

/// The name that the partner of a picture would have, by the names of another pair.
fn partner(of: &Path, own: &Path, other: &Path) -> PathBuf {
    let folder = other.parent().unwrap_or(Path::new(""));
    let name = of.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let same_names = own.file_name() == other.file_name();
    let (from, to) = match side(&stem(own)).0 {
        _ if same_names => return folder.join(name),
        'l' => ("left", "right"),
        'r' => ("right", "left"),
        _ => return folder.join(name),
    };
    let named = name.to_ascii_lowercase().find(from);
    folder.join(match named {
        Some(at) => format!("{}{to}{}", &name[..at], &name[at + from.len()..]),
        None => name,
    })
}

/// What a folder without pairs holds, after ": "; empty if nothing that helps. Also whether that says what to do.
fn hint(folder: &Path) -> (String, bool) {
    let Ok(entries) = std::fs::read_dir(folder) else { return (String::new(), false) };
    let mut here: Vec<PathBuf> = entries.take(MAX_EXAMINED).flatten().map(|entry| entry.path()).collect();
    here.sort();
    if let Some(recording) = other_recording(&here) {
        return (recording, true);
    }
    for (left, right) in LAYOUTS {
        let (there, missing) = match (folder.join(left).is_dir(), folder.join(right).is_dir()) {
            (true, false) => (left, right),
            (false, true) => (right, left),
            _ => continue,
        };
        return (format!(": it has a folder {there}, but none named {missing}"), false);
    }
    let pictures: Vec<&PathBuf> = here.iter().filter(|path| is_picture(path)).collect();
    let text = match (&pictures[..], &here[..]) {
        ([], []) => ": it is empty".into(),
        ([], [file]) => format!(": it holds {}", name(file)),
        ([], [file, ..]) => format!(": it holds {} files, such as {}", here.len(), name(file)),
        ([first, ..], _) => {
            let of = |wanted: char| pictures.iter().filter(|path| side(&stem(path)).0 == wanted).count();
            let pictures =
                |count: usize| if count == 1 { "1 picture".to_owned() } else { format!("{count} pictures") };
            match (of('l'), of('r')) {
                (0, 0) => format!(
                    ": it holds pictures such as {}, without left or right in their names",
                    name(first)
                ),
                (count, 0) => format!(": it holds {} of the left camera, none of the right", pictures(count)),
                (0, count) => format!(": it holds {} of the right camera, none of the left", pictures(count)),
                _ => String::new(),
            }
        }
    };
    (text, false)
}

/// A recording of another kind in a folder, or a folder with pairs in it, and what to do.
fn other_recording(here: &[PathBuf]) -> Option<String> {
    if let Some(file) =
        here.iter().find(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap")))
    {
        return Some(format!(": it holds {}: give that file, {}", name(file), file.display()));
    }
    let video = |wanted: char| {
        here.iter().find(|path| foreign::is_video(path) && side(&stem(path)).0 == wanted && path.is_file())
    };
    if let (Some(left), Some(right)) = (video('l'), video('r')) {
        let (left, right) = (left.display(), right.display());
        return Some(format!(
            ": it holds a video of each camera: give them with --left {left} --right {right} (source.left, source.right)"
        ));
    }
    // Pictures and settings may lie in any folder.
    let is_usual = |path: &PathBuf| is_picture(path) || path.extension().is_some_and(|e| e == "toml");
    for file in here.iter().filter(|path| path.is_file() && !is_usual(path)) {
        if let Some(explanation) = foreign::explain(file) {
            return Some(format!(": it holds {}, {explanation}", name(file)));
        }
    }
    let has_pairs =
        |path: &&PathBuf| LAYOUTS.iter().any(|(l, r)| path.join(l).is_dir() && path.join(r).is_dir());
    let inner = here.iter().find(has_pairs)?;
    Some(format!(": its folder {} has pairs: give {}", name(inner), inner.display()))
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        folder
    }

    /// The names of the pairs, below the folder.
    fn names(folder: &tempfile::TempDir, pairs: Result<Pairs, SourceError>) -> Vec<String> {
        let below = |path: &Path| path.strip_prefix(folder.path()).unwrap().display().to_string();
        pairs.unwrap().pairs.iter().map(|(l, r)| format!("{} {}", below(l), below(r))).collect()
    }

    #[test]
    fn names_are_paired_in_every_layout() {
        for (files, expected) in [
            (
                ["left/1.png", "right/1.png", "left/10.png", "right/10.png", "left/9.png", "right/9.png"],
                vec!["left/1.png right/1.png", "left/9.png right/9.png", "left/10.png right/10.png"],
            ),
            (
                ["left_1.tif", "right_1.tif", "left_2.tif", "right_2.tif", "notes.txt", "x.png"],
                vec!["left_1.tif right_1.tif", "left_2.tif right_2.tif"],
            ),
            (
                [
                    "left/a_left.png",
                    "right/a_right.png",
                    "left/b_left.png",
                    "right/b_right.png",
                    "rig.toml",
                    "x",
                ],
                vec!["left/a_left.png right/a_right.png", "left/b_left.png right/b_right.png"],
            ),
            (
                ["cam0/5.bmp", "cam1/5.webp", "cam0/6.bmp", "cam0/x.txt", "cam1/7.webp", "cam1/y"],
                vec!["cam0/5.bmp cam1/5.webp", "cam0/6.bmp cam1/6.bmp", "cam0/7.webp cam1/7.webp"],
            ),
            (
                ["frame_1_left.png", "frame_1_right.png", "frame_2_left.png", "frame_3_right.png", "a", "b"],
                vec![
                    "frame_1_left.png frame_1_right.png",
                    "frame_2_left.png frame_2_right.png",
                    "frame_3_left.png frame_3_right.png",
                ],
            ),
        ] {
            let folder = folder(&files);
            assert_eq!(names(&folder, find(folder.path())), expected);
        }
    }

    #[test]
    fn patterns_pair_by_what_their_stars_stand_for() {
        let folder =
            folder(&["a/L01.png", "a/L02.png", "a/R01.png", "a/R02.png", "b/x.png", "b/y.png", "b/z.txt"]);
        let by = |left: &str, right: &str| by_patterns(&folder.path().join(left), &folder.path().join(right));
        let found = by("a/L*.png", "a/R*.png");
        assert_eq!(names(&folder, found), ["a/L01.png a/R01.png", "a/L02.png a/R02.png"]);
        let found = by("a/L*.png", "b/*.png");
        assert!(found.as_ref().unwrap().is_by_order);
        assert_eq!(names(&folder, found), ["a/L01.png b/x.png", "a/L02.png b/y.png"]);
        assert_eq!(by("a", "a").unwrap().pairs.len(), 4, "what opens them refuses one file twice");
        for (left, right, expected) in [
            ("a/*.png", "b/x.png", ["no left picture has a partner", "--left"]),
            ("a/X*.png", "b/*.png", ["matches no picture", "quotes"]),
            ("b/*.txt", "b/*.png", ["matches files, but no pictures", "TIFF"]),
            ("nowhere", "b", ["nowhere", "no such file or folder"]),
        ] {
            let error = by(left, right).unwrap_err().to_string();
            assert!(expected.iter().all(|part| error.contains(part)), "{error}");
        }
    }

    #[test]
    fn a_folder_without_pairs_is_told_by_what_it_holds() {
        for (files, expected) in [
            (["bag/metadata.yaml", "drive.mcap"], ["it holds drive.mcap", "give that file"]),
            (["drive.db3", "metadata.yaml"], ["ROS 2 bag in SQLite", "mcap convert"]),
            (["day/left/1.png", "day/right/1.png"], ["its folder day has pairs: give ", "/day"]),
            (["left/1.png", "rights/1.png"], ["it has a folder left", "none named right"]),
            (["one.png", "two.png"], ["such as one.png", "without left or right"]),
            (["left_1.png", "left_2.png"], ["2 pictures of the left camera", "none of the right"]),
            (["notes.txt", "more.txt"], ["2 files", "such as more.txt"]),
            (["drive.mp4", "notes.txt"], ["drive.mp4, a video", "both images side by side"]),
            (["left.mp4", "right.mp4"], ["a video of each camera: give them with --left ", "right.mp4"]),
        ] {
            let error = find(folder(&files).path()).unwrap_err().to_string();
            assert!(expected.iter().all(|part| error.contains(part)), "{error}");
            assert!(error.contains("no stereo pairs here: "), "{error}");
        }
        let error = find(folder(&["left/a.exr", "right/a.exr"]).path()).unwrap_err().to_string();
        assert!(error.contains("left: no pictures here: it holds a.exr: put PNG"), "{error}");
    }
}
