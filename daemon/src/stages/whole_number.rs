//! Conversion of integers from the configuration.

/// The value as the type of a parameter. The configuration has checked its range, so it fits.
pub fn whole<T: TryFrom<i64> + Default>(value: i64) -> T {
    T::try_from(value).unwrap_or_default()
}
