//! Files that a configuration names: relative to the configuration's own folder, and where a key stands in its file.

use crate::tables::Config;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// The keys that name files and folders which have to be there.
type Named<'a> = [(&'static str, &'a mut PathBuf); 11];

fn named(config: &mut Config) -> Named<'_> {
    let source = &mut config.source;
    [
        ("source.path", &mut source.path),
        ("source.left", &mut source.left),
        ("source.right", &mut source.right),
        ("source.rig", &mut source.rig),
        ("recognition.network", &mut config.recognition.network),
        ("recognition.cascade", &mut config.recognition.cascade),
        ("vehicle.motion", &mut config.vehicle.motion),
        ("vehicle.dbc", &mut config.vehicle.dbc),
        ("bridge.tls_ca", &mut config.bridge.tls_ca),
        ("bridge.tls_certificate", &mut config.bridge.tls_certificate),
        ("bridge.tls_key", &mut config.bridge.tls_key),
    ]
}

/// Takes relative paths of a configuration as relative to its file, where there is something; otherwise they are relative
/// to the working directory. Names that are no paths, such as the cascade that ships, stay as they are.
pub(crate) fn resolve(config: &mut Config, file: &Path) {
    let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) else { return };
    let mut detectors = std::mem::take(&mut config.recognition.detectors);
    let named = named(config).into_iter().map(|(_, path)| path);
    for path in named.chain(detectors.iter_mut().map(|detector| &mut detector.model)) {
        // Of a pattern such as `cam0/*.png` the first part is there.
        let first: PathBuf = path.components().take(1).collect();
        let is_there = if path.to_string_lossy().contains(['*', '?']) {
            path.components().count() == 1 || folder.join(first).is_dir()
        } else {
            folder.join(&*path).exists()
        };
        if !path.as_os_str().is_empty() && path.is_relative() && is_there {
            *path = folder.join(&*path);
        }
    }
    config.recognition.detectors = detectors;
}

/// Where a file sets a key, as `FILE:LINE: `; empty if it does not.
pub fn place(file: Option<&Path>, key: &str) -> String {
    let find = || {
        let text = std::fs::read_to_string(file?).ok()?;
        let (table, key) = key.split_once('.')?;
        let document = DeTable::parse(&text).ok()?;
        let at = document.get_ref().get(table)?.get_ref().as_table()?.get(key)?.span().start;
        let line = text.get(..at)?.matches('\n').count() + 1;
        Some(format!("{}:{line}: ", file?.display()))
    };
    find().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::key::Kind;
    use crate::keys;

    #[test]
    fn each_named_key_is_a_path() {
        for (name, _) in named(&mut Config::default()) {
            let key = keys::all().find(|key| key.path() == name).unwrap();
            assert_eq!(key.kind, Kind::Path, "{name}");
        }
    }

    #[test]
    fn paths_are_relative_to_their_file_where_something_is_there() {
        let folder = std::env::temp_dir().join(format!("lookout-config-paths-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("cam0")).unwrap();
        let file = folder.join("car.toml");
        std::fs::write(folder.join("rig.toml"), "").unwrap();
        std::fs::write(
            &file,
            "[source]\nkind = \"folder\"\nrig = \"rig.toml\"\nleft = \"cam0/*.png\"\nright = \"cam1/*.png\"\npath = \"gone\"\n",
        )
        .unwrap();
        let config = crate::load(Some(&file)).unwrap();
        assert_eq!(config.source.rig, folder.join("rig.toml"));
        assert_eq!(config.source.left, folder.join("cam0/*.png"));
        assert_eq!(config.source.right, Path::new("cam1/*.png"));
        assert_eq!(config.source.path, Path::new("gone"));
        assert_eq!(config.recognition.network, Path::new("objects"));
        assert_eq!(place(Some(&file), "source.rig"), format!("{}:3: ", file.display()));
        assert_eq!(
            (place(Some(&file), "alarm.hold_ms"), place(None, "source.rig")),
            (String::new(), String::new())
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
