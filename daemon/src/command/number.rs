//! Parsers of numeric arguments.

use std::fmt::Display;
use std::str::FromStr;

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

/// A parser of whole numbers from `low` to `high`; without an upper bound if `high` is the type's largest.
pub fn whole<T>(low: T, high: T) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: Whole,
{
    move |text| match text.parse::<T>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ if high == T::MAX => Err(format!("give a whole number, at least {low}")),
        _ => Err(format!("give a whole number from {low} to {high}")),
    }
}

/// A type of [`whole`].
pub trait Whole: FromStr + PartialOrd + Copy + Display + Send + Sync + 'static {
    /// Its largest value.
    const MAX: Self;
}

macro_rules! whole {
    ($($type:ty),+) => {
        $(impl Whole for $type {
            const MAX: Self = <$type>::MAX;
        })+
    };
}

whole!(u16, u32, u64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_refused_with_their_range() {
        assert_eq!(whole(1_u32, 10)("10"), Ok(10));
        for text in ["0", "11", "ten", "1.5", "-1", ""] {
            assert_eq!(whole(1_u32, 10)(text), Err("give a whole number from 1 to 10".into()), "{text}");
        }
        assert_eq!(whole(1, u64::MAX)("0"), Err("give a whole number, at least 1".into()));
    }
}
