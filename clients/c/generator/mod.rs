//! Renders the declarations of the records for C, Python and the reference. Part of a test and of an example.

#![allow(dead_code, reason = "the test and the example each use their own part")]

mod c;
mod constants;
mod declaration;
mod python;
mod reference;

pub use declaration::structures;
use std::path::{Path, PathBuf};

/// First line of everything that is generated.
const NOTE: &str =
    "Generated from the Rust declarations by: cargo run -p lookout-client-c --example generate";

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn source(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Path and text of each file.
pub fn all() -> [(&'static str, String); 3] {
    let structures = structures();
    [
        ("clients/c/include/lookout.h", c::header(&structures)),
        ("clients/python/lookout/_layout.py", python::module(&structures)),
        ("docs/client-records.md", reference::page(&structures)),
    ]
}
