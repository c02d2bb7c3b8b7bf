//! The corners of a calibration as a text file, for other programs to calibrate from.

use super::PicturePair;
use perception::calibration::{Board, Pair, Places, StereoCalibration};
use std::ffi::OsStr;
use std::fmt::Write;
use std::path::Path;

/// The corners that a calibration used, as mrcal reads them (`mrcal-calibrate-cameras --corners-cache`): a line for each corner of
/// the board, row by row, with the file name of the image, column and row in px, and a level: 0, or −1 for a corner that is not seen or
/// was left out. Images of views that were left out are not in it.
pub fn text(
    board: &Board,
    files: &[PicturePair],
    corners: &[Pair],
    calibration: &StereoCalibration,
) -> String {
    let mut text = "# filename x y level\n".to_owned();
    let count = board.points_m().len();
    let used = calibration.views.iter().zip(files).zip(corners).filter(|((view, _), _)| view.fault.is_none());
    for ((view, files), pair) in used {
        for (side, (path, places)) in
            [(&files.left, &pair.left), (&files.right, &pair.right)].into_iter().enumerate()
        {
            let name = name(path, files.left.parent() != files.right.parent());
            let is_used = |i: usize| !view.rejected.contains(&(side, i));
            for i in 0..count {
                let _ = match place(places, i).filter(|_| is_used(i)) {
                    Some([x, y]) => writeln!(text, "{name} {x:.4} {y:.4} 0"),
                    None => writeln!(text, "{name} 0 0 -1"),
                };
            }
        }
    }
    text
}

/// Name of an image, unique among those of both cameras: with its folder if each camera has its own. Fields end at white space.
fn name(path: &Path, has_own_folder: bool) -> String {
    let of = |path: Option<&OsStr>| path.map(OsStr::to_string_lossy).unwrap_or_default().into_owned();
    let file = of(path.file_name());
    let folder = path.parent().map(|folder| of(folder.file_name())).filter(|_| has_own_folder);
    let name = folder.map_or(file.clone(), |folder| format!("{folder}/{file}"));
    name.replace(char::is_whitespace, "_")
}

fn place(places: &Places, i: usize) -> Option<[f64; 2]> {
    places.get(i).copied().flatten().map(|place| [place.x, place.y])
}
