//! Image pairs of a folder: two subfolders, or files whose names contain "left" and "right".

use sources::SourceError;
use sources::folder::{LAYOUTS, images};
use sources::natural::natural;
use sources::pairs::side;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a folder has no pairs.
#[derive(Debug, Error)]
pub enum PicturesError {
    /// The folder cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The folder has none of the known layouts.
    #[error(
        "{}: no images of a stereo pair: put them into two folders, left and right, with the same names \
         in both, or name them left1.png, right1.png, …",
        path.display()
    )]
    None {
        /// The folder.
        path: PathBuf,
    },
    /// Images of one camera only.
    #[error("{}: {count} images of the {side} camera, none of the other: add those", path.display())]
    OneSide {
        /// The folder.
        path: PathBuf,
        /// Number of images.
        count: usize,
        /// `left` or `right`.
        side: &'static str,
    },
}

/// An image pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PicturePair {
    /// Name of the left image without extension.
    pub name: String,
    /// The left image.
    pub left: PathBuf,
    /// The right image.
    pub right: PathBuf,
}

/// The pairs of a folder in natural order of their names, and the images without a partner.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pictures {
    /// Pairs.
    pub pairs: Vec<PicturePair>,
    /// Images without a partner.
    pub single: Vec<PathBuf>,
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

impl Pictures {
    /// Finds the pairs of a folder.
    ///
    /// # Errors
    /// When the folder cannot be read, or has no images of two cameras.
    pub fn find(folder: &Path) -> Result<Self, PicturesError> {
        if !folder.is_dir() {
            let explanation = "there is no such folder: give one with the pictures of the board".into();
            return Err(SourceError::Foreign { path: folder.to_owned(), explanation }.into());
        }
        let here = images(folder)?;
        let sides = LAYOUTS.iter().map(|(l, r)| (folder.join(l), folder.join(r)));
        let (lefts, rights): (Vec<_>, Vec<_>) =
            match sides.into_iter().find(|(l, r)| l.is_dir() || r.is_dir()) {
                Some((l, r)) => {
                    let list = |folder: &Path| -> Result<Vec<(String, PathBuf)>, SourceError> {
                        if !folder.is_dir() {
                            return Ok(Vec::new());
                        }
                        Ok(images(folder)?.into_iter().map(|p| (side(&stem(&p)).1, p)).collect())
                    };
                    (list(&l)?, list(&r)?)
                }
                None => {
                    let of = |wanted: char| {
                        let named = |p: &PathBuf| (side(&stem(p)), p.clone());
                        here.iter()
                            .map(named)
                            .filter(|((s, _), _)| *s == wanted)
                            .map(|((_, k), p)| (k, p))
                            .collect()
                    };
                    (of('l'), of('r'))
                }
            };
        match (lefts.len(), rights.len()) {
            (0, 0) => return Err(PicturesError::None { path: folder.to_owned() }),
            (count, 0) => {
                return Err(PicturesError::OneSide { path: folder.to_owned(), count, side: "left" });
            }
            (0, count) => {
                return Err(PicturesError::OneSide { path: folder.to_owned(), count, side: "right" });
            }
            _ => {}
        }
        let mut pictures = Self::default();
        for (key, left) in &lefts {
            match rights.iter().find(|(k, _)| k == key) {
                Some((_, right)) => pictures.pairs.push(PicturePair {
                    name: stem(left),
                    left: left.clone(),
                    right: right.clone(),
                }),
                None => pictures.single.push(left.clone()),
            }
        }
        let lonely = rights.iter().filter(|(k, _)| !lefts.iter().any(|(l, _)| l == k));
        pictures.single.extend(lonely.map(|(_, p)| p.clone()));
        pictures.pairs.sort_by(|a, b| natural(&a.name, &b.name));
        pictures.single.sort();
        Ok(pictures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"x").unwrap();
        }
        folder
    }

    #[test]
    fn both_layouts_are_paired_by_name() {
        let flat =
            folder(&["left2.jpg", "left10.jpg", "right2.jpg", "right10.jpg", "left3.jpg", "notes.txt"]);
        let found = Pictures::find(flat.path()).unwrap();
        let names: Vec<&str> = found.pairs.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["left2", "left10"]);
        assert_eq!(found.single.len(), 1);
        let two = folder(&["left/a_left.png", "right/a_right.png", "left/b.png", "right/b.png"]);
        assert_eq!(Pictures::find(two.path()).unwrap().pairs.len(), 2);
    }

    #[test]
    fn one_camera_and_none_are_said() {
        let one = folder(&["left1.png", "left2.png"]);
        let error = Pictures::find(one.path()).unwrap_err().to_string();
        assert!(error.contains("2 images of the left camera, none of the other"), "{error}");
        assert!(matches!(Pictures::find(folder(&["a.png"]).path()), Err(PicturesError::None { .. })));
        assert!(Pictures::find(Path::new("/no/such")).unwrap_err().to_string().contains("/no/such"));
    }
}
