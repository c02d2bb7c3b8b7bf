//! Texts of cascades: those that ship, and files.

use sources::bounded_file;
use sources::limits::CASCADE;
use std::borrow::Cow;
use std::path::Path;

/// Name of the built-in HOG model, which is often taken for a cascade.
pub const PEOPLE: &str = "people";

/// The XML of a cascade that ships with the daemon, by its name. It is not part of the program and has its own licence:
/// see models/README.md.
fn shipped(name: &Path) -> Option<&'static str> {
    #[cfg(feature = "models")]
    if name == Path::new("vehicle") {
        return Some(include_str!("../../../../models/vehicle.xml"));
    }
    let _ = name;
    None
}

/// The XML of a cascade: of one that ships, by its name, or of a file.
///
/// # Errors
/// If the file cannot be read, or is too large.
pub fn text(path: &Path) -> std::io::Result<Cow<'static, str>> {
    match shipped(path) {
        Some(text) => Ok(Cow::Borrowed(text)),
        None if path == Path::new(PEOPLE) && !path.exists() => {
            Err(std::io::Error::other("the built-in model of people is a HOG model, no cascade"))
        }
        None => bounded_file::read_text(path, &CASCADE).map(Cow::Owned),
    }
}
