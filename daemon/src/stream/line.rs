//! The text of a line.

use super::topics::{HEAD, STATUS, Topics};
use serde_json::{Map, Value};
use std::fmt::Write;

/// Fields of a line and their values.
pub type Fields = Map<String, Value>;

/// The line of a frame as a JSON object without its closing brace: the head, then the topics.
pub fn open_object(fields: &Fields, topics: &Topics) -> String {
    let mut text = String::from("{");
    let head = HEAD.iter().filter_map(|name| fields.get_key_value(*name));
    let others = fields.iter().filter(|(name, _)| !HEAD.contains(&name.as_str()) && topics.has(name));
    for (name, value) in head.chain(others) {
        let separator = if text.len() > 1 { "," } else { "" };
        // Writing to a string never fails; a string shown as JSON is quoted and escaped.
        let _ = write!(text, "{separator}{}:{value}", Value::from(name.as_str()));
    }
    text
}

/// The daemon's state as a field; `json` is an object.
pub fn status_field(json: &str) -> String {
    format!("\"{STATUS}\":{json}")
}

/// A line with the daemon's state alone.
pub fn status_alone(run: &str, field: &str) -> String {
    format!("{{\"run\":{},{field}}}\n", Value::from(run))
}

/// Completes the line of a frame.
pub fn close_object(open: &str, status: Option<&str>) -> String {
    match status {
        Some(field) => format!("{open},{field}}}\n"),
        None => format!("{open}}}\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_line_is_one_object_with_its_head_first() {
        let Value::Object(fields) = json!({"alarm": {"level": "clear\n"}, "obstacles": [], "run": "a\"b", "sequence": 3, "status": 1})
        else {
            panic!("an object")
        };
        let open = open_object(&fields, &Topics::of(&["alarm".into()]));
        assert_eq!(open, r#"{"run":"a\"b","sequence":3,"alarm":{"level":"clear\n"}"#);
        let line = close_object(&open, Some(&status_field(r#"{"state":"running"}"#)));
        assert!(line.ends_with('\n') && line.matches('\n').count() == 1);
        let parsed: Value = serde_json::from_str(&line).unwrap();
        assert_eq!(parsed["status"]["state"], "running");
        assert_eq!(open_object(&Fields::new(), &Topics::all()), "{");
        let alone: Value = serde_json::from_str(&status_alone("r", &status_field("{}"))).unwrap();
        assert_eq!(alone, json!({"run": "r", "status": {}}));
    }
}
