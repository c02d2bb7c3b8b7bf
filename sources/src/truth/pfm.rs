//! PFM files as in Middlebury: one float per pixel, rows from the bottom up.

use super::error::TruthError;
use crate::bounded_file;
use crate::limits::PICTURE;
use std::path::Path;

/// Contents of a PFM, with rows from the top down.
#[derive(Clone, Debug, PartialEq)]
pub struct Pfm {
    /// Values, row-major; not finite where unknown.
    pub values: Vec<f32>,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

/// Reads a one-channel PFM. Of the scale in its header only the sign is used (negative: little-endian), as
/// Middlebury specifies.
///
/// # Errors
/// Names the file, the fault and the remedy.
pub fn read(path: &Path) -> Result<Pfm, TruthError> {
    let io = |source| TruthError::Io { path: path.to_owned(), source };
    let map = |reason| TruthError::Map { path: path.to_owned(), reason };
    parse(&bounded_file::read(path, &PICTURE).map_err(io)?).map_err(map)
}

/// Takes the next token of the header, and the one white space (or CR LF) that ends it.
fn word<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
    let text = &rest[start..];
    // Header tokens are short: a binary file without white space has none.
    let end = text.iter().take(40).position(u8::is_ascii_whitespace)?;
    let line_end = if text[end..].starts_with(b"\r\n") { 2 } else { 1 };
    *rest = &text[end + line_end..];
    std::str::from_utf8(&text[..end]).ok()
}

fn parse(bytes: &[u8]) -> Result<Pfm, String> {
    const EXPECTED: &str = "expected \"Pf\", width, height and scale: give a one-channel PFM";
    let mut rest = bytes;
    match word(&mut rest) {
        Some("Pf") => {}
        Some("PF") => return Err("a PFM of three channels: give the one-channel disparity map".into()),
        _ => return Err(format!("not a PFM; {EXPECTED}")),
    }
    let mut side = |what: &str| {
        let text = word(&mut rest).ok_or(format!("the header ends before the {what}; {EXPECTED}"))?;
        match text.parse::<usize>() {
            Ok(value) if value > 0 => Ok(value),
            _ => Err(format!("the {what} is \"{text}\", not a whole number above 0; {EXPECTED}")),
        }
    };
    let (width, height) = (side("width")?, side("height")?);
    let text = word(&mut rest).ok_or(format!("the header ends before the scale; {EXPECTED}"))?;
    let scale = text.parse::<f64>().ok().filter(|s| s.is_finite() && *s != 0.0);
    let scale = scale.ok_or(format!("the scale is \"{text}\", not a number other than 0; {EXPECTED}"))?;
    let needed = width.checked_mul(height).and_then(|n| n.checked_mul(4));
    let Some(data) = needed.and_then(|n| rest.get(..n)) else {
        return Err(format!(
            "truncated: {} bytes of pixels are there, {width}x{height} need {}: fetch the file again",
            rest.len(),
            needed.map_or("more than memory holds".into(), |n| n.to_string())
        ));
    };
    let float = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let values = data
        .chunks_exact(4 * width)
        .rev()
        .flat_map(|row| row.chunks_exact(4).map(|b| float([b[0], b[1], b[2], b[3]])))
        .collect();
    Ok(Pfm { values, width, height })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, values: &[f32], little: bool) -> Vec<u8> {
        let mut bytes = header.as_bytes().to_vec();
        for v in values {
            bytes.extend(if little { v.to_le_bytes() } else { v.to_be_bytes() });
        }
        bytes
    }

    #[test]
    fn both_byte_orders_are_read_from_the_bottom_up() {
        let values = [1.0, 2.0, f32::INFINITY, 4.0, 5.0, 6.5];
        let turned = vec![4.0, 5.0, 6.5, 1.0, 2.0, f32::INFINITY];
        for (header, little) in [
            ("Pf\n3 2\n-0.00392\n", true),
            ("Pf\n3 2\n1.0\n", false),
            ("Pf 3\n2 -1 ", true),
            ("Pf\r\n3 2\r\n-1\r\n", true),
        ] {
            let pfm = parse(&file(header, &values, little)).unwrap();
            assert_eq!(pfm, Pfm { values: turned.clone(), width: 3, height: 2 }, "{header:?}");
        }
    }

    #[test]
    fn faults_are_told_apart() {
        for (header, expected) in [
            ("P5\n3 2\n-1\n", "not a PFM"),
            ("", "not a PFM"),
            ("PF\n3 2\n-1\n", "three channels"),
            ("Pf\n3 x\n-1\n", "the height is \"x\""),
            ("Pf\n0 2\n-1\n", "the width is \"0\""),
            ("Pf\n-3 2\n-1\n", "the width is \"-3\""),
            ("Pf\n3 2", "ends before the height"),
            ("Pf\n3 2\n0\n", "the scale is \"0\""),
            ("Pf\n3 2\nnan\n", "the scale is \"nan\""),
            ("Pf\n3 2\n-1\n", "truncated: 8 bytes of pixels are there, 3x2 need 24"),
            ("Pf\n4294967296 4294967296\n-1\n", "need more than memory"),
            ("Pf\n100000000 100000000\n-1\n", "need 40000000000000000"),
        ] {
            let error = parse(&file(header, if header.ends_with("-1\n") { &[1.0, 2.0] } else { &[] }, true))
                .unwrap_err();
            assert!(error.contains(expected), "{header:?}: {error}");
        }
        // Truncated input is an error, never a panic.
        for cut in 0..40 {
            let whole = file("Pf\n3 2\n-1.0\n", &[0.0; 6], true);
            assert_eq!(parse(&whole[..cut.min(whole.len())]).is_ok(), cut >= whole.len(), "{cut}");
        }
        let error = read(Path::new("/nowhere/d.pfm")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/d.pfm"), "{error}");
    }
}
