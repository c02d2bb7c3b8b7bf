//! Folders of training images, read in an order that keeps sequences together.

use super::error::TrainError;
use perception::image::GreyImage;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// An image with its path.
#[derive(Clone, Debug)]
pub struct SourcePicture {
    /// Path of the file.
    pub path: PathBuf,
    /// Grey pixels.
    pub grey: GreyImage,
}

const ENDINGS: [&str; 6] = ["png", "jpg", "jpeg", "pgm", "ppm", "pnm"];

/// Natural order: numbers within names compare by value, so frame 9 precedes frame 10.
fn by_number(a: &str, b: &str) -> Ordering {
    let parts = |text: &str| {
        let mut parts: Vec<(String, u64)> = vec![(String::new(), 0)];
        let mut digits = false;
        for c in text.chars() {
            let last = parts.len() - 1;
            match c.to_digit(10) {
                Some(digit) => {
                    digits = true;
                    parts[last].1 = parts[last].1.saturating_mul(10).saturating_add(digit.into());
                }
                None if digits => {
                    digits = false;
                    parts.push((c.into(), 0));
                }
                None => parts[last].0.push(c),
            }
        }
        parts
    };
    parts(a).cmp(&parts(b)).then_with(|| a.cmp(b))
}

/// The images of `folder` and of each of its subfolders, one list per folder, in natural order.
///
/// # Errors
/// When a folder or image cannot be read, or there is no image.
pub fn read(folder: &Path) -> Result<Vec<Vec<SourcePicture>>, TrainError> {
    let mut sequences = Vec::new();
    read_into(folder, &mut sequences)?;
    if sequences.is_empty() {
        let endings = ENDINGS.join(", ");
        return Err(TrainError::Data(format!(
            "{}: no images ({endings}) in this folder or its subfolders",
            folder.display()
        )));
    }
    Ok(sequences)
}

fn read_into(folder: &Path, sequences: &mut Vec<Vec<SourcePicture>>) -> Result<(), TrainError> {
    let wrong = |error: std::io::Error| TrainError::Data(format!("{}: {error}", folder.display()));
    let mut paths = std::fs::read_dir(folder)
        .map_err(wrong)?
        .map(|e| e.map(|e| e.path()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(wrong)?;
    paths.sort_by(|a, b| by_number(&a.to_string_lossy(), &b.to_string_lossy()));
    let mut sequence = Vec::new();
    for path in paths {
        if path.is_dir() {
            read_into(&path, sequences)?;
            continue;
        }
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if !ending.is_some_and(|e| ENDINGS.contains(&e.as_str())) {
            continue;
        }
        let (pixels, width, height) = sources::folder::read_grey(&path)?;
        let grey = GreyImage::from_vec(pixels, width, height)
            .map_err(|error| TrainError::Data(format!("{}: {error}", path.display())))?;
        sequence.push(SourcePicture { path, grey });
    }
    if !sequence.is_empty() {
        sequences.push(sequence);
    }
    Ok(())
}

/// Images for training and for validation.
#[derive(Clone, Debug, Default)]
pub struct Split {
    /// The first part of each folder.
    pub training: Vec<SourcePicture>,
    /// The last part of each folder: consecutive frames stay together.
    pub validation: Vec<SourcePicture>,
}

/// Splits each folder's images; the last `share` is for validation.
pub fn split(sequences: Vec<Vec<SourcePicture>>, share: f64) -> Split {
    let mut result = Split::default();
    for mut sequence in sequences {
        let kept = ((1.0 - share) * sequence.len() as f64).round() as usize;
        let last = sequence.split_off(kept.min(sequence.len()));
        result.training.append(&mut sequence);
        result.validation.extend(last);
    }
    result
}

/// Removes the last `share` of each folder's images and returns them separately.
pub fn hold_out(
    mut sequences: Vec<Vec<SourcePicture>>,
    share: f64,
) -> (Vec<Vec<SourcePicture>>, Vec<SourcePicture>) {
    let mut held = Vec::new();
    for sequence in &mut sequences {
        let kept = ((1.0 - share) * sequence.len() as f64).round() as usize;
        held.extend(sequence.split_off(kept.min(sequence.len())));
    }
    (sequences, held)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn save(path: &Path, value: u8) {
        crate::reporting::picture::save_grey(path, &[value; 9], 3, 3).expect("the picture is written");
    }

    #[test]
    fn folders_are_sequences_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(folder.path().join("a")).expect("a folder");
        for (i, number) in [10_u8, 9, 100, 1].into_iter().enumerate() {
            save(&folder.path().join(format!("a/f{number}.png")), number);
            save(&folder.path().join(format!("{i}.png")), 7);
        }
        std::fs::write(folder.path().join("notes.txt"), "no picture").expect("a file");
        let sequences = read(folder.path()).expect("pictures");
        assert_eq!(sequences.iter().map(Vec::len).collect::<Vec<_>>(), [4, 4]);
        let values: Vec<u8> = sequences[0].iter().map(|p| p.grey.as_slice()[0]).collect();
        assert_eq!(values, [1, 9, 10, 100]);
        let split = split(sequences, 0.25);
        assert_eq!((split.training.len(), split.validation.len()), (6, 2));
        assert_eq!(split.validation[0].grey.as_slice()[0], 100);
        let (rest, held) = hold_out(read(folder.path()).expect("pictures"), 0.25);
        assert_eq!((rest.iter().map(Vec::len).sum::<usize>(), held.len()), (6, 2));
    }

    #[test]
    fn an_empty_folder_and_a_broken_picture_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let error = read(folder.path()).expect_err("empty").to_string();
        assert!(error.contains("no images"), "{error}");
        std::fs::write(folder.path().join("x.png"), "no picture").expect("a file");
        let error = read(folder.path()).expect_err("broken").to_string();
        assert!(error.contains("x.png"), "{error}");
    }
}
