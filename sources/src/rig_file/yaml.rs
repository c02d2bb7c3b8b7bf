//! The subset of YAML that calibration files use: nested maps, flow and block lists, plain scalars. Tags and
//! directives are skipped.

use crate::limits::MAX_YAML_DEPTH;
use perception::excerpt::{VALUE_CHARS, excerpt};

/// A node of a document.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A scalar.
    Word(String),
    /// A list.
    List(Vec<Value>),
    /// A map in file order.
    Map(Vec<(String, Value)>),
}

struct Line {
    number: usize,
    indent: usize,
    text: String,
}

/// Parses a document.
///
/// # Errors
/// Names the line.
pub fn parse(text: &str) -> Result<Value, String> {
    let mut lines: Vec<Line> = Vec::new();
    let mut open = 0_i32;
    for (i, raw) in text.lines().enumerate() {
        let text = without_comment(raw).trim_end();
        if text.trim().is_empty() || text.starts_with('%') || text.trim() == "---" || text.trim() == "..." {
            continue;
        }
        // A flow list may continue over several lines.
        if open > 0
            && let Some(last) = lines.last_mut()
        {
            last.text.push(' ');
            last.text.push_str(text.trim());
        } else {
            let mut indent = text.len() - text.trim_start().len();
            let mut rest = text.trim();
            // A nested list that starts on the line of its parent's dash becomes a line of its own.
            while let Some(inner) =
                rest.strip_prefix("- ").map(str::trim_start).filter(|i| i.starts_with("- "))
            {
                lines.push(Line { number: i + 1, indent, text: "-".into() });
                indent += rest.len() - inner.len();
                rest = inner;
            }
            lines.push(Line { number: i + 1, indent, text: rest.to_owned() });
        }
        for c in text.chars() {
            open += match c {
                '[' => 1,
                ']' => -1,
                _ => 0,
            };
        }
        if open < 0 {
            return Err(format!("line {}: a bracket closes that was not opened", i + 1));
        }
    }
    if open > 0 {
        return Err("a bracket is never closed".into());
    }
    let mut at = 0;
    let value = block(&lines, &mut at, 0, 0)?;
    match lines.get(at) {
        Some(line) => Err(format!("line {}: unexpected indentation", line.number)),
        None => Ok(value),
    }
}

fn too_deep(line: usize) -> String {
    format!("line {line}: nested too deeply: a calibration has at most {MAX_YAML_DEPTH} levels")
}

fn without_comment(line: &str) -> &str {
    match line.find('#') {
        Some(0) => "",
        Some(at) if line[..at].ends_with(' ') => &line[..at],
        _ => line,
    }
}

/// Whether a line is a list item.
fn is_item(line: &Line) -> bool {
    line.text == "-" || line.text.starts_with("- ")
}

/// Parses the lines from `at` on that are indented by `indent` or more.
fn block(lines: &[Line], at: &mut usize, indent: usize, depth: usize) -> Result<Value, String> {
    let Some(first) = lines.get(*at) else { return Ok(Value::Map(Vec::new())) };
    if depth > MAX_YAML_DEPTH {
        return Err(too_deep(first.number));
    }
    let own = first.indent;
    if own < indent {
        return Ok(Value::Word(String::new()));
    }
    let mut items = Vec::new();
    let mut keys = Vec::new();
    while let Some(line) = lines.get(*at).filter(|l| l.indent == own) {
        let dash = is_item(line);
        // List items may be indented as little as the surrounding keys.
        if dash && !keys.is_empty() || !dash && !items.is_empty() {
            break;
        }
        *at += 1;
        if line.text == "-" {
            items.push(block(lines, at, own + 1, depth + 1)?);
            continue;
        }
        if let Some(item) = line.text.strip_prefix("- ") {
            items.push(flow(item, line.number)?);
            continue;
        }
        let Some((key, rest)) = line.text.split_once(':') else {
            let found = excerpt(&line.text, VALUE_CHARS);
            return Err(format!("line {}: expected KEY: VALUE, found \"{found}\"", line.number));
        };
        let rest = rest.trim();
        let rest =
            if rest.starts_with("!!") { rest.split_once(' ').map_or("", |r| r.1.trim()) } else { rest };
        let value = if rest.is_empty() {
            // A block list may be indented as little as its key.
            let dashes = lines.get(*at).is_some_and(|l| l.indent == own && is_item(l));
            block(lines, at, if dashes { own } else { own + 1 }, depth + 1)?
        } else {
            flow(rest, line.number)?
        };
        keys.push((unquoted(key.trim()).to_owned(), value));
    }
    if keys.is_empty() { Ok(Value::List(items)) } else { Ok(Value::Map(keys)) }
}

fn unquoted(word: &str) -> &str {
    let quoted = |q: char| word.strip_prefix(q).and_then(|w| w.strip_suffix(q));
    quoted('"').or_else(|| quoted('\'')).unwrap_or(word)
}

/// Parses a scalar or a flow list on one line.
fn flow(text: &str, number: usize) -> Result<Value, String> {
    let text = text.trim();
    if !text.starts_with('[') {
        return Ok(Value::Word(unquoted(text).to_owned()));
    }
    let mut stack: Vec<Vec<Value>> = Vec::new();
    let mut word = String::new();
    for c in text.chars() {
        match c {
            '[' => stack.push(Vec::new()),
            ',' | ']' => {
                let trimmed = word.trim();
                if !trimmed.is_empty()
                    && let Some(top) = stack.last_mut()
                {
                    top.push(Value::Word(unquoted(trimmed).to_owned()));
                }
                word.clear();
                if c == ']' {
                    let list = Value::List(stack.pop().unwrap_or_default());
                    match stack.last_mut() {
                        Some(above) => above.push(list),
                        None => return Ok(list),
                    }
                }
            }
            _ => word.push(c),
        }
        if stack.len() > MAX_YAML_DEPTH {
            return Err(too_deep(number));
        }
    }
    Err(format!("line {number}: a list is not closed"))
}

impl Value {
    /// Value of a key in a map.
    pub fn get(&self, key: &str) -> Option<&Value> {
        match self {
            Self::Map(keys) => keys.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// The scalar as text.
    pub fn word(&self) -> Option<&str> {
        match self {
            Self::Word(word) => Some(word),
            _ => None,
        }
    }

    /// The scalar as a number.
    pub fn number(&self) -> Option<f64> {
        self.word()?.parse().ok().filter(|v: &f64| v.is_finite())
    }

    /// All numbers of a nested list in order: the data of a matrix.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Self::Word(_) => Some(vec![self.number()?]),
            Self::List(items) => {
                let parts: Option<Vec<Vec<f64>>> = items.iter().map(Value::numbers).collect();
                Some(parts?.concat())
            }
            Self::Map(_) => self.get("data")?.numbers(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_calibration_files_use_is_read() {
        let text = "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 1\n   dt: d\n   data: [ 1., 2.5e+00,\n      -3 ]\n\
                    name: \"left # 1\"\ncam0:\n  list:\n  - [1, 2]\n  - [3, 4]\n  deep: {}\nT:\n- 5\n- 6 # why\n\
                    rows:\n- - 1.5\n  - 2\n- - - 3\n    - 4\n  -\n    - 5\nend: 1\n";
        let v = parse(text).unwrap();
        assert_eq!(v.get("M1").unwrap().numbers().unwrap(), [1.0, 2.5, -3.0]);
        assert_eq!(v.get("cam0").unwrap().get("list").unwrap().numbers().unwrap(), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(v.get("T").unwrap().numbers().unwrap(), [5.0, 6.0]);
        assert_eq!(v.get("rows").unwrap().numbers().unwrap(), [1.5, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(v.get("end").unwrap().number(), Some(1.0));
        assert_eq!(v.get("M1").unwrap().get("rows").unwrap().number(), Some(1.0));
    }

    #[test]
    fn faults_name_the_line_and_nothing_panics() {
        assert!(parse("a: [1, 2").unwrap_err().contains("never closed"));
        assert!(parse("a: 1]").unwrap_err().contains("line 1"));
        assert!(parse("a: 1\nnothing").unwrap_err().contains("line 2"));
        assert!(parse(&"[".repeat(99)).is_err());
        let deep: String = (0..99).map(|i| format!("{}a:\n", " ".repeat(i))).collect();
        assert!(parse(&deep).is_err());
        assert!(parse(&"- ".repeat(99)).is_err());
        assert_eq!(parse("").unwrap(), Value::Map(Vec::new()));
    }
}
