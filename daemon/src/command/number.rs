//! Parsers of numeric arguments.

/// A rate in frames per second, 0.01 to 1000.
///
/// # Errors
/// Names the range.
pub fn fps(text: &str) -> Result<f64, String> {
    number(text, 0.01, 1000.0)
}

/// A number from `low` to `high`.
///
/// # Errors
/// Names the range.
pub fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("give a number from {low} to {high}")),
    }
}
