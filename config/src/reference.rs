//! `docs/configuration.md`, written from the table of keys.

use crate::check::{load, profile_names};
use crate::keys;
use std::fmt::Write;

/// The text of `docs/configuration.md`: every key with its default, range and effect.
pub fn reference() -> String {
    let defaults = load(None).ok().and_then(|c| toml::Table::try_from(c).ok()).unwrap_or_default();
    let mut out = String::from(
        "# Configuration\n\n\
         A configuration is a TOML file, given with `-c FILE`. What it leaves out comes from the profile that\n\
         its first line may name (`profile = \"tk1\"`), else from `replay`. `-c` also takes a profile's name.\n\
         `lookout check-config FILE` prints every error with its line and the effective configuration.\n\n",
    );
    let names: Vec<String> = profile_names().map(|n| format!("`{n}`")).collect();
    let _ = writeln!(out, "Profiles: {}.\n", names.join(", "));
    out.push_str("This page is written by `lookout check-config --reference`; a test keeps it true.\n");
    let mut table = "";
    for key in keys::all() {
        let Some((name, last)) = key.name.split_once('.') else { continue };
        if name != table {
            table = name;
            let _ = write!(out, "\n## [{table}]\n\n| key | default | range | what |\n|---|---|---|---|\n");
        }
        let default =
            defaults.get(table).and_then(|t| t.get(last)).map(ToString::to_string).unwrap_or_default();
        let _ = writeln!(out, "| `{last}` | `{default}` | {} | {} |", key.kind, key.text);
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_key_is_documented() {
        let page = include_str!("../../docs/configuration.md");
        assert!(
            page == super::reference(),
            "docs/configuration.md is stale: run `lookout check-config --reference > docs/configuration.md`"
        );
        for key in crate::keys::all() {
            assert!(key.text.len() > 20, "{} needs a sentence", key.name);
        }
    }
}
