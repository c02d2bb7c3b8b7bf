//! The crates that are linked into the program.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A crate from a registry.
pub struct Crate {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Its licence, an SPDX expression.
    pub licence: String,
    /// Its authors, as its manifest names them; often none.
    pub authors: Vec<String>,
    /// The folder of its sources.
    pub folder: PathBuf,
}

fn cargo(root: &Path, arguments: &[&str]) -> Result<String, String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo).args(arguments).current_dir(root).output();
    let output = output.map_err(|error| format!("cargo: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo {}: {}", arguments.join(" "), String::from_utf8_lossy(&output.stderr)));
    }
    String::from_utf8(output.stdout).map_err(|error| format!("cargo {}: {error}", arguments.join(" ")))
}

/// All crates on which `lookout` depends on `target`, not for building or testing only. Procedural macros count,
/// because the code that they write is linked. `features` is a list as for `cargo build --features`.
///
/// # Errors
/// If cargo fails, or a crate names no licence.
pub fn linked(root: &Path, target: &str, features: &str) -> Result<Vec<Crate>, String> {
    let qualified: Vec<String> = features.split([',', ' ']).filter(|f| !f.is_empty()).map(qualify).collect();
    let qualified = qualified.join(",");
    // Only `cargo tree` resolves features exactly as a build of this package; only the metadata have folders.
    let tree = ["tree", "--locked", "-p", "lookout", "-e", "normal", "--prefix", "none", "-f", "{p}"];
    let tree = cargo(root, &[&tree[..], &["--target", target, "--features", &qualified]].concat())?;
    let names: BTreeSet<(&str, &str)> = tree
        .lines()
        .filter_map(|line| {
            let mut words = line.split(' ');
            Some((words.next()?, words.next()?.strip_prefix('v')?))
        })
        .collect();
    let metadata = ["metadata", "--locked", "--format-version", "1", "--filter-platform", target];
    let metadata = cargo(root, &[&metadata[..], &["--features", &qualified]].concat())?;
    let metadata: Value = serde_json::from_str(&metadata).map_err(|error| format!("metadata: {error}"))?;
    let packages = metadata["packages"].as_array().ok_or("metadata without packages")?;
    let mut crates = Vec::new();
    for (name, version) in names {
        let package = packages.iter().find(|p| p["name"] == name && p["version"] == version);
        let package = package.ok_or_else(|| format!("{name} {version} is not in the metadata"))?;
        // Those without a source are the project's own.
        if package["source"].is_null() {
            continue;
        }
        let licence =
            package["license"].as_str().ok_or_else(|| format!("{name} {version} names no licence"))?;
        let manifest = package["manifest_path"].as_str().unwrap_or_default();
        let authors = package["authors"].as_array().into_iter().flatten().filter_map(Value::as_str);
        crates.push(Crate {
            name: name.to_owned(),
            version: version.to_owned(),
            licence: licence.to_owned(),
            authors: authors.map(str::to_owned).collect(),
            folder: Path::new(manifest).parent().unwrap_or(root).to_owned(),
        });
    }
    Ok(crates)
}

fn qualify(feature: &str) -> String {
    if feature.contains('/') { feature.to_owned() } else { format!("lookout/{feature}") }
}
