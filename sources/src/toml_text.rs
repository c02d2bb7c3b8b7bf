//! Parses TOML with errors of bounded length that name the line.

use perception::excerpt::{REASON_CHARS, VALUE_CHARS, excerpt};
use serde::de::DeserializeOwned;
use std::fmt;

/// Why a text cannot be parsed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TomlError {
    /// Line number, from 1.
    pub line: Option<usize>,
    /// What is wrong.
    pub reason: String,
}

impl fmt::Display for TomlError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        f.write_str(&self.reason)
    }
}

/// Parses a text.
///
/// # Errors
/// Names the line, and the value where it is short.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T, TomlError> {
    toml::from_str(text).map_err(|error| {
        let span = error.span();
        let line = span.as_ref().map(|span| {
            let before = &text.as_bytes()[..span.start.min(text.len())];
            before.iter().filter(|&&b| b == b'\n').count() + 1
        });
        let value = span.and_then(|span| text.get(span));
        let value = value.filter(|v| v.len() < VALUE_CHARS && !v.contains('\n'));
        let reason = excerpt(error.message().trim_end(), REASON_CHARS);
        let reason = value.map_or_else(|| reason.to_string(), |value| format!("{reason} (at `{value}`)"));
        TomlError { line, reason }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_line_and_do_not_repeat_megabytes() {
        let fault = |text: &str| parse::<std::collections::BTreeMap<String, u8>>(text).unwrap_err();
        assert_eq!(fault("a = 1\nb = \"x\"\n").to_string().split(": ").next(), Some("line 2"));
        assert!(fault("a = 300\n").reason.contains("(at `300`)"));
        let long = "x".repeat(1 << 18);
        for text in [format!("{long} = 1\n{long} = 2\n"), format!("a = \"{long}\""), "[".repeat(1 << 18)] {
            assert!(fault(&text).to_string().len() < 1200, "{}", fault(&text).to_string().len());
        }
    }
}
