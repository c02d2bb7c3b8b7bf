//! Point clouds as PLY files: binary, little-endian, one colour per point.

use crate::reporting::picture::Colour;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Bytes per point: three f32, three u8.
const POINT_BYTES: usize = 15;

/// A point cloud cannot be written.
#[derive(Debug, Error)]
#[error("{}: cannot be written: {source}", path.display())]
pub struct PlyError {
    path: PathBuf,
    source: io::Error,
}

/// Writes points (x, y, z in metres, and a fourth value) with the colour that `colour` returns for each. The
/// file is written atomically.
///
/// # Errors
/// When it cannot be written.
pub fn save(path: &Path, points: &[[f32; 4]], colour: impl Fn(&[f32; 4]) -> Colour) -> Result<(), PlyError> {
    let part = path.with_extension("part");
    let written = create(&part, points, colour).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|source| PlyError { path: path.to_owned(), source })
}

fn create(path: &Path, points: &[[f32; 4]], colour: impl Fn(&[f32; 4]) -> Colour) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    write(&mut file, points, colour)?;
    file.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}

/// Writes the content of such a file.
///
/// # Errors
/// When it cannot be written.
pub fn write(
    file: &mut impl Write,
    points: &[[f32; 4]],
    colour: impl Fn(&[f32; 4]) -> Colour,
) -> io::Result<()> {
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\n\
         comment metres; x right, y down, z ahead of the left camera\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )?;
    for point in points {
        let mut bytes = [0; POINT_BYTES];
        for (target, value) in bytes.chunks_exact_mut(4).zip(point) {
            target.copy_from_slice(&value.to_le_bytes());
        }
        bytes[12..].copy_from_slice(&colour(point));
        file.write_all(&bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_size_and_values_agree() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        let points = [[1.0, -2.5, 30.0, 7.0], [0.0, 0.25, 4.0, 200.0]];
        save(&path, &points, |p| [p[3] as u8, 1, 2]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
        assert!(header.contains("\nelement vertex 2\n"), "{header}");
        let body = &bytes[end..];
        assert_eq!(body.len(), 2 * POINT_BYTES);
        let value = |at: usize| f32::from_le_bytes(body[at..at + 4].try_into().unwrap());
        assert_eq!([value(0), value(4), value(8)], [1.0, -2.5, 30.0]);
        assert_eq!(&body[12..15], [7, 1, 2]);
        assert_eq!((value(POINT_BYTES + 8), body[POINT_BYTES + 12]), (4.0, 200));
        assert!(!folder.path().join("cloud.part").exists());
        let error = save(&folder.path().join("no/such.ply"), &points, |_| [0; 3]).unwrap_err();
        assert!(error.to_string().contains("no/such.ply"), "{error}");
    }
}
