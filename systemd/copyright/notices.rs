//! Copyright and licence notices in Debian's machine-readable format:
//! <https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/>.

use super::crates::Crate;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// C sources that a crate compiles: crate, folder in it, name of the library, licence.
const BUNDLED: [(&str, &str, &str, &str); 2] = [
    ("lz4-sys", "liblz4/lib", "lz4", "BSD-2-Clause"),
    // Its headers offer GPL-2 as an alternative. MIT is libdivsufsort's.
    ("zstd-sys", "zstd", "zstd", "BSD-3-Clause AND MIT"),
];

/// Crates whose C sources are their own, under the crate's licence.
const OWN_SOURCES: [&str; 5] = ["iceoryx2-pal-posix", "psm", "ring", "signal-hook", "stacker"];

/// Licences: SPDX name; how its terms begin; words that it has to contain, without spaces, in lower case; words that it
/// may not contain.
const KINDS: [(&str, &str, &str, &str); 13] = [
    ("Apache-2.0 WITH LLVM-exception", "--- LLVM Exceptions", "llvmexceptions", "\0"),
    ("Apache-2.0", "Apache License", "apachelicenseversion2.0,january2004", "llvmexceptions"),
    ("MIT", "Permission is hereby granted", "permissionisherebygranted,freeofcharge", "unicodelicense"),
    ("BSD-2-Clause", "Redistribution and use", "redistributionanduseinsource", "endorseorpromote"),
    ("BSD-3-Clause", "Redistribution and use", "endorseorpromote", "\0"),
    ("Zlib", "This software is provided", "notbemisrepresentedasbeingtheoriginal", "\0"),
    ("ISC", "Permission to use", "permissionnoticeappearinallcopies", "\0"),
    ("0BSD", "Permission to use", "permissiontouse,copy,modify,and/ordistribute", "appearinallcopies"),
    ("Unlicense", "This is free and unencumbered", "thisisfreeandunencumberedsoftware", "\0"),
    ("Unicode-3.0", "NOTICE TO DATA FILE", "unicodelicensev3", "\0"),
    ("BSL-1.0", "Permission is hereby granted", "boostsoftwarelicense-version1.0", "\0"),
    (
        "CDLA-Permissive-2.0",
        "Community Data License",
        "communitydatalicenseagreement-permissive-version2.0",
        "\0",
    ),
    ("MPL-2.0", "Mozilla Public License", "mozillapubliclicenseversion2.0", "\0"),
];

/// Where Debian keeps the text of a licence, so that a package need not.
const APACHE: &str = "On Debian systems, the text is in /usr/share/common-licenses/Apache-2.0.";

/// Where the package keeps the terms of the models.
const RESEARCH: &str = "For research and non-commercial use: /usr/share/lookout/models/README.md says why and\n\
                        /usr/share/doc/lookout/models-license is the text. The program holds these models, too.";

/// A part of the program with its own notices.
struct Part {
    files: String,
    copyright: Vec<String>,
    /// SPDX expression.
    licence: String,
    comment: String,
    /// Terms that its own files hold: SPDX name and text.
    terms: Vec<(&'static str, String)>,
}

fn squeezed(text: &str) -> String {
    text.chars().filter(|c| !c.is_whitespace() && *c != '*').flat_map(char::to_lowercase).collect()
}

/// The licences in a text, each with its terms, without title and copyright notices.
fn terms(text: &str) -> Vec<(&'static str, String)> {
    let squeezed = squeezed(text);
    let is_kind = |kind: &&(&str, &str, &str, &str)| squeezed.contains(kind.2) && !squeezed.contains(kind.3);
    let kinds = KINDS.iter().filter(is_kind);
    kinds.map(|kind| (kind.0, text[text.find(kind.1).unwrap_or(0)..].trim_end().to_owned())).collect()
}

/// The copyright notices in a text.
fn copyrights(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for line in text.lines() {
        let line = line.trim_matches(|c: char| c.is_whitespace() || "*/#-.".contains(c));
        let lower = line.to_lowercase();
        let Some(rest) = lower.strip_prefix("portions ").unwrap_or(&lower).strip_prefix("copyright") else {
            continue;
        };
        let rest = rest.trim_start_matches([':', ' ']);
        let is_notice = rest.starts_with("(c)")
            || rest.starts_with('©')
            || rest.starts_with(|c: char| c.is_ascii_digit())
            || rest.starts_with("the ");
        let is_prose =
            ["notice", "license", "holder", "owner]", "[yyyy]", "yyyy"].iter().any(|w| rest.contains(w));
        if is_notice && !is_prose && !found.iter().any(|f| f == line) {
            found.push(line.to_owned());
        }
    }
    found
}

/// Licence files in a folder, with their contents.
fn licence_files(folder: &Path) -> Result<Vec<(String, String)>, String> {
    let fail = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_uppercase();
        let is_ours =
            ["LICENSE", "LICENCE", "COPYRIGHT", "UNLICENSE", "NOTICE"].iter().any(|s| name.starts_with(s));
        if is_ours && path.is_file() {
            let text = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
            files.push((name, String::from_utf8_lossy(&text).into_owned()));
        }
    }
    files.sort();
    Ok(files)
}

/// C sources below a folder. Those of tests are not compiled: `tests`, and `test` of nix.
fn c_sources(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), String> {
    let fail = |error: std::io::Error| format!("{}: {error}", folder.display());
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        if path.is_dir() && !path.ends_with("tests") && !path.ends_with("test") {
            c_sources(&path, found)?;
        } else if path.extension().is_some_and(|e| ["c", "h", "cc", "cpp", "S"].iter().any(|s| e == *s)) {
            found.push(path);
        }
    }
    Ok(())
}

/// The licence of a crate as an SPDX expression. Of the two that zenoh offers, the one that fits the others is taken; its crates
/// come without the text of either.
fn chosen(licence: &str) -> String {
    licence.split('/').map(str::trim).collect::<Vec<_>>().join(" OR ").replace("EPL-2.0 OR ", "")
}

/// The notices of a crate and, if it compiles C sources, of these.
fn parts(krate: &Crate) -> Result<Vec<Part>, String> {
    let Crate { name, version, .. } = krate;
    let files = licence_files(&krate.folder)?;
    let mut copyright: Vec<String> = files.iter().flat_map(|(_, text)| copyrights(text)).collect();
    copyright.dedup();
    if copyright.is_empty() {
        copyright.clone_from(&krate.authors);
    }
    if copyright.is_empty() {
        copyright.push(format!("the authors of {name}"));
    }
    let mut comment = format!("https://crates.io/crates/{name}/{version}");
    // Licence Apache-2.0, section 4 (d).
    for (_, notice) in files.iter().filter(|(file, _)| file.starts_with("NOTICE")) {
        let _ = write!(comment, "\n{}", notice.trim_end());
    }
    let mut parts = vec![Part {
        files: format!("crates/{name}-{version}/*"),
        copyright,
        licence: chosen(&krate.licence),
        comment,
        terms: files.iter().flat_map(|(_, text)| terms(text)).collect(),
    }];
    let mut sources = Vec::new();
    c_sources(&krate.folder, &mut sources)?;
    let bundled = BUNDLED.iter().find(|bundled| bundled.0 == name);
    let Some((_, folder, library, licence)) = bundled else {
        let is_code = |path: &&PathBuf| path.extension().is_some_and(|e| e != "h");
        return match sources.iter().find(is_code).filter(|_| !OWN_SOURCES.contains(&name.as_str())) {
            None => Ok(parts),
            Some(path) => {
                Err(format!("{}: C sources that neither BUNDLED nor OWN_SOURCES names", path.display()))
            }
        };
    };
    let folder = krate.folder.join(folder);
    let mut copyright = Vec::new();
    let mut found: Vec<(&'static str, String)> = Vec::new();
    for (_, text) in licence_files(&folder)? {
        copyright.extend(copyrights(&text));
        found.extend(terms(&text));
    }
    sources.sort();
    for path in sources.iter().filter(|path| path.starts_with(&folder)) {
        let text = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let text = String::from_utf8_lossy(&text).into_owned();
        for line in copyrights(&text) {
            if !copyright.contains(&line) {
                copyright.push(line);
            }
        }
    }
    parts.push(Part {
        files: format!("crates/{name}-{version}/{library}/*"),
        copyright,
        licence: (*licence).to_owned(),
        comment: format!("The C library {library}, which the crate {name} compiles and links."),
        terms: found,
    });
    Ok(parts)
}

/// SPDX names in an expression.
fn names(expression: &str) -> Vec<String> {
    let plain = expression.replace(['(', ')'], "");
    plain.split(" OR ").flat_map(|one| one.split(" AND ")).map(|name| name.trim().to_owned()).collect()
}

/// An SPDX expression in Debian's notation, in which "and" binds more tightly than "or" unless a comma precedes it.
fn debian(expression: &str) -> String {
    let is_or_inside = expression
        .split('(')
        .skip(1)
        .any(|inner| inner.split(')').next().is_some_and(|i| i.contains(" OR ")));
    let and = if is_or_inside { ", and " } else { " and " };
    let plain = expression.replace(" AND ", and).replace(" OR ", " or ").replace(['(', ')'], "");
    plain.replace(" WITH LLVM-exception", " with LLVM exception")
}

/// A field whose value may have several lines.
fn field(document: &mut String, name: &str, value: &str) {
    let mut lines = value.lines();
    let _ = writeln!(document, "{name}: {}", lines.next().unwrap_or_default());
    for line in lines {
        let line = line.trim_end();
        let _ = writeln!(document, " {}", if line.is_empty() { "." } else { line });
    }
}

fn own_parts() -> Vec<Part> {
    let part = |files: &str, copyright: &str, licence: &str, comment: &str| Part {
        files: files.to_owned(),
        copyright: vec![copyright.to_owned()],
        licence: licence.to_owned(),
        comment: comment.to_owned(),
        terms: Vec::new(),
    };
    vec![
        part("*", "the lookout contributors", "MIT OR Apache-2.0", ""),
        part("models/*", "the lookout contributors", "research", ""),
        part(
            "models/objects-free.onnx",
            "the lookout contributors",
            "MIT OR Apache-2.0",
            "Trained with pictures of the project's own scenes and six of Udacity's under the MIT licence.",
        ),
        part(
            "models/people.hog",
            "the contributors of OpenCV",
            "Apache-2.0",
            "The weights of OpenCV's people detector. https://opencv.org",
        ),
        part(
            "sources/src/recording/generated/*",
            "Foxglove Technologies Inc",
            "MIT",
            "Code generated from Foxglove's message schemas.",
        ),
        part(
            "rust/*",
            "The Rust Project Developers",
            "MIT OR Apache-2.0",
            "The Rust standard library, which is linked statically. https://www.rust-lang.org",
        ),
    ]
}

/// One text of a licence.
struct Variant {
    /// Without spaces, to compare.
    squeezed: String,
    text: String,
    /// Indices of the parts that use it.
    users: Vec<usize>,
}

/// Names and texts of all licences. Where the texts of one licence differ, the most frequent one has the plain name, and
/// the parts that use another are changed to its name.
fn licences(all: &mut [Part]) -> Vec<(String, String)> {
    let mut texts: BTreeMap<&str, Vec<Variant>> = BTreeMap::new();
    for (i, part) in all.iter().enumerate() {
        let wanted = names(&part.licence);
        for (kind, text) in &part.terms {
            if *kind == "Apache-2.0" || !wanted.iter().any(|name| name == kind) {
                continue;
            }
            let (known, squeezed) = (texts.entry(kind).or_default(), squeezed(text));
            match known.iter_mut().find(|variant| variant.squeezed == squeezed) {
                Some(variant) => variant.users.push(i),
                None => known.push(Variant { squeezed, text: text.clone(), users: vec![i] }),
            }
        }
    }
    let mut licences =
        vec![("Apache-2.0".to_owned(), APACHE.to_owned()), ("research".to_owned(), RESEARCH.to_owned())];
    for (kind, mut variants) in texts {
        variants.sort_by_key(|variant| std::cmp::Reverse(variant.users.len()));
        for (k, variant) in variants.into_iter().enumerate() {
            let mut name = kind.to_owned();
            if let Some(&first) = variant.users.first().filter(|_| k > 0) {
                let user = all[first].files.split('/').nth(1).unwrap_or("lookout");
                name = format!("{kind}-{user}");
                for &i in &variant.users {
                    all[i].licence = rename(&all[i].licence, kind, &name);
                }
            }
            licences.push((name, variant.text));
        }
    }
    licences
}

/// The whole document. `root` is the folder of the project.
///
/// # Errors
/// If a file cannot be read, the terms of a licence are in no crate, or a crate has C sources that are not listed in
/// [`BUNDLED`] or [`OWN_SOURCES`].
pub fn document(root: &Path, crates: &[Crate]) -> Result<String, String> {
    let mut all = own_parts();
    for krate in crates {
        all.extend(parts(krate)?);
    }
    let mit = root.join("LICENSE-MIT");
    let mit = std::fs::read_to_string(&mit).map_err(|error| format!("{}: {error}", mit.display()))?;
    all[0].terms = terms(&mit);
    let licences = licences(&mut all);
    let known: Vec<&String> = licences.iter().map(|(name, _)| name).collect();
    for part in &all {
        if let Some(name) = names(&part.licence).into_iter().find(|name| !known.contains(&name)) {
            return Err(format!("{}: no crate holds the text of the licence {name}", part.files));
        }
    }
    Ok(written(&all, &licences))
}

/// Replaces a name in an SPDX expression.
fn rename(expression: &str, from: &str, to: &str) -> String {
    let words: Vec<String> = expression
        .split(' ')
        .map(|word| {
            let bare = word.trim_matches(['(', ')']);
            if bare == from { word.replace(from, to) } else { word.to_owned() }
        })
        .collect();
    words.join(" ")
}

fn written(parts: &[Part], licences: &[(String, String)]) -> String {
    let mut document = String::from(
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\nUpstream-Name: lookout\n\
         Comment: Generated. The program is linked statically with what is listed below: \"crates/\" stands for\n \
         sources from crates.io, \"rust/\" for those of the Rust standard library.\n",
    );
    for part in parts {
        document.push('\n');
        field(&mut document, "Files", &part.files);
        field(&mut document, "Copyright", &part.copyright.join("\n"));
        field(&mut document, "License", &debian(&part.licence));
        if !part.comment.is_empty() {
            field(&mut document, "Comment", &part.comment);
        }
    }
    for (name, text) in licences {
        document.push('\n');
        field(&mut document, "License", &format!("{}\n{text}", debian(name)));
    }
    document
}
