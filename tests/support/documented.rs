//! Whether pages of the documentation name the fields of a JSON document.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Objects whose keys are data, such as names of a GPU's stages: the path of a field ends there.
const MAPS: [&str; 1] = ["stages_ms"];

/// Objects that have the fields of another one, as the pages say of them.
const SAME: [(&str, &str); 3] = [
    ("alarm_object.", "alarm.object."),
    ("alarm_changes.object.", "alarm.object."),
    ("calibration_last.", "calibration."),
];

/// Stands for the beginning of another name in the same row: `speed_m_s`, `…_sigma_m_s`.
const ABBREVIATION: char = '…';

/// What a name may begin with where it is the whole document.
const DOCUMENTS: [&str; 2] = ["status.", "summary."];

/// The paths of all values that have no fields of their own, such as `processes.work.p50_ms`. Elements of an array have
/// the path of the array.
pub fn fields(document: &Value) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    collect(document, "", &mut found);
    found
}

fn collect(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) if !fields.is_empty() => {
            for (name, value) in fields {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                if MAPS.contains(&name.as_str()) {
                    found.insert(path);
                } else {
                    collect(value, &path, found);
                }
            }
        }
        Value::Array(elements) if elements.iter().any(Value::is_object) => {
            for element in elements {
                collect(element, path, found);
            }
        }
        _ => {
            found.insert(path.to_owned());
        }
    }
}

/// The names that pages have in backticks, line by line: `alarm.level`, `obstacles[].track`, `times.<level>.frames`.
pub struct Pages {
    lines: Vec<Vec<String>>,
}

impl Pages {
    /// Reads pages of the folder docs.
    pub fn read(names: &[&str]) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
        let page = |name: &&str| std::fs::read_to_string(folder.join(name)).expect("a page");
        Self::parse(&names.iter().map(page).collect::<String>())
    }

    /// Takes the names out of a text in Markdown. Programs and examples in blocks of their own name nothing.
    pub fn parse(text: &str) -> Self {
        let (mut lines, mut is_block) = (Vec::new(), false);
        for line in text.lines() {
            if line.trim_start().starts_with("```") {
                is_block = !is_block;
            } else if !is_block {
                lines.push(line.split('`').skip(1).step_by(2).filter_map(name).collect());
            }
        }
        Self { lines }
    }

    /// The fields of a document that no line names: neither by the last parts of their path nor abbreviated.
    pub fn missing(&self, document: &Value) -> Vec<String> {
        let has = |path: &str| {
            self.has(path) || SAME.iter().any(|(this, other)| self.has(&path.replace(this, other)))
        };
        fields(document).into_iter().filter(|path| !has(path)).collect()
    }

    fn has(&self, path: &str) -> bool {
        self.lines.iter().any(|line| {
            line.iter().any(|name| match name.strip_prefix(ABBREVIATION) {
                Some(rest) => is_abbreviated(path, rest, line),
                None => ends_with(path, name),
            })
        })
    }
}

/// The name that a text in backticks is, without brackets; `None` if it is something else.
fn name(text: &str) -> Option<String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || "_.[]<>".contains(c) || c == ABBREVIATION;
    if text.is_empty() || !text.chars().all(is_part) {
        return None;
    }
    let path = text.replace("[]", "");
    let inner = DOCUMENTS.iter().find_map(|document| path.strip_prefix(document));
    Some(inner.unwrap_or(&path).to_owned())
}

/// Whether the last parts of a path are those of a name, in which `<…>` stands for any part.
fn ends_with(path: &str, name: &str) -> bool {
    let mut parts = path.rsplit('.');
    name.rsplit('.').all(|wanted| parts.next().is_some_and(|part| part == wanted || wanted.starts_with('<')))
}

/// Whether the last part of a path is `rest` after what another name of the line begins with.
fn is_abbreviated(path: &str, rest: &str, line: &[String]) -> bool {
    let begin = last(path).strip_suffix(rest).unwrap_or_default();
    !rest.is_empty() && !begin.is_empty() && line.iter().any(|other| last(other).starts_with(begin))
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or_default()
}
