//! Writes the code and the descriptor sets in `sources/src/recording/generated` from `foxglove/*.proto`:
//!
//! ```text
//! cargo run --manifest-path sources/proto/Cargo.toml
//! ```
//!
//! `foxglove.rs` and `google.protobuf.rs` hold the message types. `<Message>.bin` is the schema of a topic
//! in an MCAP file: a `FileDescriptorSet` of the message's file and of all files that it imports.

use std::error::Error;
use std::path::{Path, PathBuf};

/// Messages that are recorded; each has a file of its name.
const RECORDED: [&str; 7] = [
    "CameraCalibration",
    "CompressedImage",
    "FrameTransform",
    "ImageAnnotations",
    "PointCloud",
    "RawImage",
    "SceneUpdate",
];

const GENERATED: &str = "../src/recording/generated";

fn path_here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Writes all files into a folder that exists.
fn generate(folder: &Path) -> Result<(), Box<dyn Error>> {
    let proto = path_here("");
    let files = RECORDED.map(|name| format!("foxglove/{name}.proto"));
    for (name, file) in RECORDED.iter().zip(&files) {
        let mut compiler = protox::Compiler::new([&proto])?;
        compiler.include_imports(true).include_source_info(false).open_file(file)?;
        std::fs::write(folder.join(format!("{name}.bin")), compiler.encode_file_descriptor_set())?;
    }
    prost_build::Config::new()
        .out_dir(folder)
        // An image that is read is a part of the message's own memory, not a copy.
        .bytes(["."])
        // Two small messages; the crate prost-types would add all others.
        .compile_well_known_types()
        .disable_comments([".google"])
        .compile_fds(protox::compile(&files, [&proto])?)?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    generate(&path_here(GENERATED))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
        entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap())).collect()
    }

    #[test]
    fn the_generated_files_are_up_to_date() {
        let fresh = tempfile::tempdir().unwrap();
        generate(fresh.path()).unwrap();
        let (fresh, kept) = (files(fresh.path()), files(&path_here(GENERATED)));
        assert!(fresh.keys().eq(kept.keys()), "{:?}, checked in: {:?}", fresh.keys(), kept.keys());
        for (name, bytes) in &fresh {
            assert!(
                kept[name] == *bytes,
                "{name} is out of date: cargo run --manifest-path sources/proto/Cargo.toml"
            );
        }
    }
}
