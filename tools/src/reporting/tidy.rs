//! Rounding of numbers in records.

/// Rounds to four decimals, enough for all measured values and readable. Values that are not finite become 0,
/// as JSON cannot represent them.
pub fn tidy(value: f64) -> f64 {
    if value.is_finite() { (value * 1e4).round() / 1e4 } else { 0.0 }
}

/// [`tidy`], with `None` for values that are not finite.
pub fn tidy_finite(value: f64) -> Option<f64> {
    value.is_finite().then(|| tidy(value))
}
