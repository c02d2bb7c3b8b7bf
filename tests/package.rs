//! The terms of what is linked in: the Debian package's `copyright`, and the list of licences.

#[path = "../systemd/copyright/crates.rs"]
mod crates;
#[path = "../systemd/copyright/notices.rs"]
mod notices;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(file: &str) -> String {
    std::fs::read_to_string(root().join(file)).expect("the file is there")
}

/// Paragraphs of a document: the first field's name and value, and the whole text.
fn paragraphs(document: &str) -> Vec<(String, String, String)> {
    let paragraph = |text: &str| {
        let (name, value) = text.lines().next().expect("a line").split_once(": ").expect("a field");
        (name.to_owned(), value.to_owned(), text.to_owned())
    };
    document.split("\n\n").map(paragraph).collect()
}

#[test]
fn the_copyright_of_the_package_lists_all_that_is_linked_in_with_its_terms() {
    // Other targets need crates that a build for this machine has not fetched.
    let target = &format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    {
        let linked = crates::linked(&root(), target, "").unwrap();
        let document = notices::document(&root(), &linked).unwrap();
        let paragraphs = paragraphs(document.trim_end());
        let of = |field: &str| -> BTreeMap<String, String> {
            let own = paragraphs.iter().filter(|(name, ..)| name == field);
            own.map(|(_, value, text)| (value.clone(), text.clone())).collect()
        };
        let (files, licences) = (of("Files"), of("License"));
        // What cargo says, on its own.
        let tree = Command::new(env!("CARGO"))
            .args([
                "tree", "--locked", "-p", "lookout", "-e", "normal", "--prefix", "none", "--target", target,
            ])
            .current_dir(root())
            .output()
            .expect("cargo runs");
        let tree = String::from_utf8(tree.stdout).expect("text");
        let lines: BTreeSet<&str> = tree.lines().filter(|line| !line.contains("(/")).collect();
        assert!(lines.len() > 100, "{tree}");
        for line in lines {
            let mut words = line.split(' ');
            let (name, version) = (words.next().expect("a name"), words.next().expect("a version"));
            let key = format!("crates/{name}-{}/*", version.trim_start_matches('v'));
            assert!(files.contains_key(&key), "{target}: {key} is missing");
        }
        for (crate_, holder, licence) in [
            ("crates/iceoryx2-0", "iceoryx2", "Apache-2.0"),
            ("crates/zstd-sys-", "", "BSD-3-Clause"),
            ("crates/lz4-sys-", "Yann Collet", "BSD-2-Clause"),
            ("crates/nalgebra-", "", "Apache-2.0"),
            ("crates/unicode-ident-", "Unicode, Inc", "MIT or Apache-2.0, and Unicode-3.0"),
        ] {
            let found = files.iter().filter(|(key, _)| key.starts_with(crate_));
            let text: String = found.map(|(_, text)| text.as_str()).collect();
            assert!(text.contains(holder) && text.contains(licence), "{crate_}: {text}");
        }
        let library = |name: &str| {
            let found = files.iter().find(|(key, _)| key.ends_with(&format!("/{name}/*")));
            found.unwrap_or_else(|| panic!("the C library {name} is missing")).1.clone()
        };
        assert!(library("lz4").contains("Copyright (c) 2011-2020, Yann Collet"));
        assert!(library("zstd").contains("Meta Platforms") && library("zstd").contains("Yuta Mori"));
        // Each name has its text, and each text has a user.
        let mut used = BTreeSet::new();
        for (key, text) in &files {
            let field = |name: &str| text.lines().find_map(|l| l.strip_prefix(name).map(str::to_owned));
            assert!(field("Copyright: ").is_some_and(|c| !c.is_empty()), "{text}");
            let names = field("License: ").unwrap_or_else(|| panic!("{key} has no licence"));
            let names = names.replace(", and ", " or ").replace(" and ", " or ");
            for name in names.split(" or ") {
                assert!(
                    licences.get(name).is_some_and(|l| l.lines().count() > 1),
                    "{key}: no text of {name}"
                );
                used.insert(name.to_owned());
            }
        }
        assert_eq!(used, licences.keys().cloned().collect(), "{target}");
        // The format: no tabulators or blank lines inside a paragraph, one "Files: *" as the first.
        assert!(document.lines().all(|l| l.is_empty() || l.starts_with(' ') || l.contains(": ")), "{target}");
        assert_eq!(paragraphs.iter().find(|p| p.0 == "Files").map(|p| p.1.as_str()), Some("*"));
    }
    assert!(read("systemd/package.sh").contains("-p debian-copyright"));
}

#[test]
fn the_licences_in_the_documentation_are_those_that_are_accepted() {
    let deny: toml::Table = read("deny.toml").parse().expect("TOML");
    let allowed = deny["licenses"]["allow"].as_array().expect("a list");
    let allowed: BTreeSet<&str> = allowed.iter().filter_map(|name| name.as_str()).collect();
    let architecture = read("docs/architecture.md");
    let table = architecture.split("| licence |").nth(1).expect("the table of licences");
    let rows = table.lines().skip(2).take_while(|line| line.starts_with('|'));
    let listed: BTreeSet<&str> = rows.filter_map(|row| row.split('|').nth(1)).map(str::trim).collect();
    // Of C sources, which cargo-deny does not see.
    let bundled = BTreeSet::from(["BSD-2-Clause"]);
    assert_eq!(listed, &allowed | &bundled);
    // Each advisory that is ignored is argued there, too.
    for ignored in deny["advisories"]["ignore"].as_array().expect("a list") {
        let id = ignored["id"].as_str().expect("an id");
        assert!(architecture.contains(id), "{id} is not in docs/architecture.md");
    }
}
