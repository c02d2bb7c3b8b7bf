//! The shape of the source: no import cycles among the files of a crate, and crates that depend one way.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const CRATES: [&str; 8] =
    ["config", "ipc", "perception", "sources", "tools", "daemon", "clients/rust", "clients/c"];

/// A module as its path in the crate: `["stereo", "viterbi"]`.
type Module = Vec<String>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The source files of a crate by their modules.
fn files(folder: &Path, module: &Module, found: &mut BTreeMap<Module, String>) {
    for entry in std::fs::read_dir(folder).expect("the source is there") {
        let path = entry.expect("an entry").path();
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let mut inner = module.clone();
        if path.is_dir() {
            inner.push(name);
            files(&path, &inner, found);
        } else if path.extension().is_some_and(|e| e == "rs") && name != "tests" {
            if !["mod", "lib", "main"].contains(&&name[..]) {
                inner.push(name);
            }
            found.insert(inner, code(&std::fs::read_to_string(&path).expect("text")));
        }
    }
}

/// The text without line comments and without its test module.
fn code(text: &str) -> String {
    let end =
        text.find("\n#[cfg(test)]\nmod tests {").or_else(|| text.find("\n#[cfg(test)]\npub mod tests {"));
    let lines = text[..end.unwrap_or(text.len())].lines();
    lines.map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// The paths of a `use` tree: `a::{b, c::d}` gives `a::b` and `a::c::d`.
fn expand(tree: &str) -> Vec<String> {
    let tree = tree.trim();
    let Some((prefix, rest)) = tree.split_once('{') else {
        return vec![tree.split(" as ").next().unwrap_or("").trim().to_owned()];
    };
    let body = rest.rsplit_once('}').map_or(rest, |(body, _)| body);
    let (mut parts, mut depth, mut part) = (Vec::new(), 0, String::new());
    for c in body.chars() {
        match c {
            ',' if depth == 0 => parts.push(std::mem::take(&mut part)),
            _ => {
                depth += i32::from(c == '{') - i32::from(c == '}');
                part.push(c);
            }
        }
    }
    parts.push(part);
    let given = parts.iter().filter(|part| !part.trim().is_empty());
    given.flat_map(|part| expand(&format!("{}{}", prefix.trim(), part.trim()))).collect()
}

/// The modules that a module imports. What it only passes on (`pub use`) is no import.
fn imports(module: &Module, text: &str, all: &BTreeMap<Module, String>) -> BTreeSet<Module> {
    let is_child = |name: &str| {
        let mut child = module.clone();
        child.push(name.to_owned());
        all.contains_key(&child)
    };
    let mut found = BTreeSet::new();
    let mut add = |path: &str| {
        let mut parts: Vec<&str> = path.split("::").collect();
        let mut base = match parts[0] {
            "crate" => Vec::new(),
            "super" | "self" => module.clone(),
            child if is_child(child) => module.clone(),
            _ => return,
        };
        while let Some("super" | "self" | "crate") = parts.first().copied() {
            if parts.remove(0) == "super" {
                base.pop();
            }
        }
        base.extend(parts.iter().map(|&part| part.to_owned()));
        while !all.contains_key(&base) && base.pop().is_some() {}
        if base != *module {
            found.insert(base);
        }
    };
    for statement in text.split(';') {
        // An attribute or a brace may stand before the keyword.
        let at = statement.rfind("use ").filter(|&at| {
            let before = statement[..at].lines().last().unwrap_or("").trim();
            before.is_empty() || before.starts_with("pub")
        });
        let Some(at) = at else {
            // Paths in expressions and types.
            for (start, _) in statement.match_indices("crate::").chain(statement.match_indices("super::")) {
                let is_part =
                    statement[..start].ends_with(|c: char| c.is_alphanumeric() || "_:$".contains(c));
                let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
                let end =
                    statement[start..].find(|c: char| !is_path(c)).map_or(statement.len(), |n| start + n);
                if !is_part {
                    add(statement[start..end].trim_end_matches(':'));
                }
            }
            continue;
        };
        if statement[..at].lines().last().unwrap_or("").trim().is_empty() {
            expand(&statement[at + 4..]).iter().for_each(|path| add(path));
        }
    }
    found
}

/// A cycle, if there is one: depth-first search over the imports.
fn cycle(graph: &BTreeMap<Module, BTreeSet<Module>>) -> Option<Vec<Module>> {
    fn visit(
        module: &Module,
        graph: &BTreeMap<Module, BTreeSet<Module>>,
        path: &mut Vec<Module>,
        done: &mut BTreeSet<Module>,
    ) -> Option<Vec<Module>> {
        if let Some(at) = path.iter().position(|m| m == module) {
            return Some(path[at..].to_vec());
        }
        if done.contains(module) {
            return None;
        }
        path.push(module.clone());
        let found = graph.get(module)?.iter().find_map(|next| visit(next, graph, path, done));
        path.pop();
        done.insert(module.clone());
        found
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|module| visit(module, graph, &mut Vec::new(), &mut done))
}

#[test]
fn no_crate_has_an_import_cycle() {
    for name in CRATES {
        let mut all = BTreeMap::new();
        files(&root().join(name).join("src"), &Vec::new(), &mut all);
        let graph = all.iter().map(|(module, text)| (module.clone(), imports(module, text, &all))).collect();
        assert_eq!(cycle(&graph), None, "{name}: these modules import each other");
    }
}

#[test]
fn an_import_cycle_would_be_found() {
    let text = |s: &str| code(s);
    let module = |s: &str| s.split("::").map(str::to_owned).collect::<Module>();
    let all = BTreeMap::from([
        (Vec::new(), text("pub use a::One;\nmod a;\nmod b;")),
        (module("a"), text("use super::b::{inner::Two, Three};\n")),
        (module("b"), text("pub mod inner;\nuse std::fmt;\n")),
        (module("b::inner"), text("fn two() -> crate::a::One {} // a remark\n")),
    ]);
    let graph: BTreeMap<_, _> = all.iter().map(|(m, t)| (m.clone(), imports(m, t, &all))).collect();
    assert_eq!(graph[&module("a")], BTreeSet::from([module("b"), module("b::inner")]));
    assert_eq!(graph[&Module::new()], BTreeSet::new(), "a re-export is no import");
    let found = cycle(&graph).expect("a and b::inner import each other");
    assert_eq!(found.len(), 2, "{found:?}");
}

#[test]
fn crates_depend_one_way() {
    // Each crate may use those before it; the message crate knows no algorithms, and the algorithms know nothing.
    let allowed: [(&str, &[&str]); 8] = [
        ("perception", &[]),
        ("ipc", &[]),
        ("config", &["messages", "perception"]),
        ("sources", &["perception"]),
        ("tools", &["perception", "sources"]),
        ("daemon", &["config", "messages", "perception", "sources", "tools"]),
        ("clients/rust", &["messages"]),
        ("clients/c", &["client"]),
    ];
    for (name, may) in allowed {
        let text = std::fs::read_to_string(root().join(name).join("Cargo.toml")).expect("a manifest");
        let manifest: toml::Table = text.parse().expect("TOML");
        let dependencies = manifest["dependencies"].as_table().expect("a table");
        for own in ["config", "messages", "perception", "sources", "tools", "client", "client-c"] {
            assert!(!dependencies.contains_key(own) || may.contains(&own), "{name} must not use {own}");
        }
    }
}
