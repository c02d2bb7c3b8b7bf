//! Whole numbers of the configuration.

/// The number as the type of a parameter: the configuration is checked to fit when it is read.
pub fn whole<T: TryFrom<i64> + Default>(value: i64) -> T {
    T::try_from(value).unwrap_or_default()
}
