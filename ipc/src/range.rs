//! Valid ranges of the numbers in messages.
//!
//! Each record declares the range of each of its fields once, beside its layout, with `ranges!`; a field that is
//! left out does not compile. What is derived from it: the check where a message is read, the limits where one is
//! written, and the tests of both.

use std::fmt;
use thiserror::Error;

/// Maximum source time, in ns: Unix time in nanoseconds stays below it until 2096, and it is below 2^62, so that no
/// sum of two times overflows.
pub const MAX_SOURCE_NS: u64 = 4_000_000_000_000_000_000;

/// Maximum time of CLOCK_MONOTONIC, and maximum duration, in ns: 31 years since boot.
pub const MAX_CLOCK_NS: u64 = 1_000_000_000_000_000_000;

/// Maximum processor time of a process, in ns: four cores for [`MAX_CLOCK_NS`].
pub const MAX_CPU_NS: u64 = 4 * MAX_CLOCK_NS;

/// Maximum of counts and of sizes in bytes: 2^53, up to which the numbers of JSON and of Prometheus are exact.
pub const MAX_COUNT: u64 = 1 << 53;

/// Maximum process id: PID_MAX_LIMIT of Linux.
pub(crate) const MAX_PID: u32 = 1 << 22;

/// Maximum magnitude of positions and sizes, in metres: 30 times the farthest region that can be configured.
pub(crate) const MAX_METRES: f64 = 10_000.0;

/// Maximum magnitude of speeds, in m/s: ten times that of the tracker.
pub(crate) const MAX_SPEED_M_S: f64 = 1000.0;

/// Maximum of finite times to collision, in seconds: [`MAX_METRES`] at the smallest speed that counts as approaching.
pub(crate) const MAX_COLLISION_S: f64 = 1e9;

/// Maximum of durations that are given in milliseconds: [`MAX_CLOCK_NS`].
pub(crate) const MAX_MS: f32 = 1e12;

/// Maximum of rates, in 1/s: one event in a nanosecond.
pub(crate) const MAX_RATE_HZ: f64 = 1e9;

/// Maximum magnitude of positions in the image plane, in px: the limit of a rig's principal point.
pub(crate) const MAX_PLANE_PX: f64 = 100_000.0;

/// A number in an error text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// A whole number.
    Whole(u64),
    /// A whole number with a sign.
    Signed(i64),
    /// A floating-point number.
    Real(f64),
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(value) => value.fmt(f),
            Self::Signed(value) => value.fmt(f),
            // Very large numbers are readable only with an exponent.
            Self::Real(value) if value.abs() >= 1e9 => write!(f, "{value:e}"),
            Self::Real(value) => value.fmt(f),
        }
    }
}

/// A number is out of range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("{record}: {field} is {value}, valid is {min} to {max}")]
pub struct RangeError {
    /// Message or record.
    pub record: &'static str,
    /// Name of the field.
    pub field: &'static str,
    /// Its value.
    pub value: Number,
    /// Its smallest valid value.
    pub min: Number,
    /// Its largest valid value; a field that may be infinite may also have that value.
    pub max: Number,
}

/// The field that a number belongs to, for error texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Message or record.
    pub record: &'static str,
    /// Field of it.
    pub name: &'static str,
}

/// Which values of a field are valid.
pub(crate) trait Rule<T> {
    /// Refuses a value that is not valid.
    fn check(&self, value: &T, field: Field) -> Result<(), RangeError>;

    /// Moves a number to the nearest valid one. What is not a number stays, and is refused where it is read.
    fn limit(&self, value: &mut T);

    /// The valid values in words, for documentation; `None` where there is nothing to say.
    fn text(&self) -> Option<String>;

    /// Values that are not valid, made from a valid one: just outside each limit, and far outside.
    #[cfg(test)]
    fn invalid(&self, valid: T) -> Vec<T>;
}

/// [`Rule::text`] of a field's rule.
pub(crate) fn text_of<S, T>(rule: &impl Rule<T>, _: impl Fn(&S) -> &T) -> Option<String> {
    rule.text()
}

/// A record whose fields all have ranges.
pub(crate) trait Ranged: Copy {
    /// Checks every field.
    ///
    /// # Errors
    /// The first field that is out of range.
    fn check(&self) -> Result<(), RangeError>;

    /// Moves every number to the nearest valid one.
    fn limit(&mut self);

    /// The valid values of each field in words, by the names of the fields.
    fn texts() -> Vec<(&'static str, Option<String>)>;

    /// Copies of this valid record in each of which one field is not valid, with the name of that field.
    #[cfg(test)]
    fn invalid(self) -> Vec<(&'static str, Self)>;
}

/// A primitive number.
pub(crate) trait Primitive: Copy + PartialOrd {
    fn number(self) -> Number;

    #[cfg(test)]
    fn outside(min: Self, max: Self) -> Vec<Self>;
}

macro_rules! whole {
    ($($type:ident as $number:ident($wide:ident),)*) => {
        $(impl Primitive for $type {
            fn number(self) -> Number {
                Number::$number($wide::from(self))
            }

            #[cfg(test)]
            fn outside(min: Self, max: Self) -> Vec<Self> {
                let near = [min.checked_sub(1), max.checked_add(1)];
                let far = [Self::MIN, Self::MAX].into_iter().filter(|v| !(min..=max).contains(v));
                near.into_iter().flatten().chain(far).collect()
            }
        })*
    };
}

whole! {
    u16 as Whole(u64),
    u32 as Whole(u64),
    u64 as Whole(u64),
    i32 as Signed(i64),
}

macro_rules! real {
    ($($type:ident)*) => {
        $(impl Primitive for $type {
            fn number(self) -> Number {
                Number::Real(self.into())
            }

            #[cfg(test)]
            fn outside(min: Self, max: Self) -> Vec<Self> {
                vec![min.next_down(), max.next_up(), Self::MIN, Self::MAX, Self::NAN, Self::NEG_INFINITY]
            }
        })*
    };
}

real! { f32 f64 }

/// Numbers from a minimum to a maximum.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Within<T> {
    min: T,
    max: T,
    /// Whether positive infinity is valid, too.
    or_infinite: bool,
}

/// Numbers from `min` to `max`.
pub(crate) const fn within<T>(min: T, max: T) -> Within<T> {
    Within { min, max, or_infinite: false }
}

/// Numbers from `min` to `max`, and positive infinity.
pub(crate) const fn within_or_infinite(min: f64, max: f64) -> Within<f64> {
    Within { min, max, or_infinite: true }
}

/// Counts and sizes in bytes: 0 to [`MAX_COUNT`].
pub(crate) const COUNT: Within<u64> = within(0, MAX_COUNT);

/// Counts of 32 bits, and numbers that only identify something: every value is valid.
pub(crate) const ANY_U32: Within<u32> = within(0, u32::MAX);

/// 0 or 1.
pub(crate) const FLAG: Within<u32> = within(0, 1);

/// Padding: 0.
pub(crate) const PADDING: Within<u32> = within(0, 0);

/// Times of CLOCK_MONOTONIC and durations, in ns.
pub(crate) const CLOCK_NS: Within<u64> = within(0, MAX_CLOCK_NS);

/// Durations in milliseconds.
pub(crate) const MS: Within<f32> = within(0.0, MAX_MS);

/// Lengths and their standard deviations, in metres.
pub(crate) const METRES: Within<f64> = within(0.0, MAX_METRES);

/// Lateral positions, in metres.
pub(crate) const LATERAL_M: Within<f64> = within(-MAX_METRES, MAX_METRES);

/// Shares.
pub(crate) const SHARE: Within<f64> = within(0.0, 1.0);

impl<T: Primitive> Within<T> {
    fn is_valid(&self, value: T) -> bool {
        let is_infinite = || value.number() == Number::Real(f64::INFINITY);
        (self.min <= value && value <= self.max) || (self.or_infinite && is_infinite())
    }
}

impl<T: Primitive> Rule<T> for Within<T> {
    #[inline]
    fn check(&self, value: &T, Field { record, name }: Field) -> Result<(), RangeError> {
        if self.is_valid(*value) {
            return Ok(());
        }
        let [value, min, max] = [*value, self.min, self.max].map(Primitive::number);
        Err(RangeError { record, field: name, value, min, max })
    }

    fn limit(&self, value: &mut T) {
        if self.is_valid(*value) {
            return;
        }
        if *value < self.min {
            *value = self.min;
        } else if *value > self.max {
            *value = self.max;
        }
    }

    fn text(&self) -> Option<String> {
        let [min, max] = [self.min, self.max].map(Primitive::number);
        let is_any = min == Number::Whole(0) && max == Number::Whole(u32::MAX.into());
        let or_infinite = if self.or_infinite { ", or infinite" } else { "" };
        match is_any {
            true => None,
            false if min == max => Some(format!("{min}")),
            false => Some(format!("{min} to {max}{or_infinite}")),
        }
    }

    #[cfg(test)]
    fn invalid(&self, _: T) -> Vec<T> {
        T::outside(self.min, self.max).into_iter().filter(|v| !self.is_valid(*v)).collect()
    }
}

/// Text and other bytes: every value is valid.
pub(crate) struct AnyBytes;

impl<const N: usize> Rule<[u8; N]> for AnyBytes {
    fn check(&self, _: &[u8; N], _: Field) -> Result<(), RangeError> {
        Ok(())
    }

    fn limit(&self, _: &mut [u8; N]) {}

    fn text(&self) -> Option<String> {
        None
    }

    #[cfg(test)]
    fn invalid(&self, _: [u8; N]) -> Vec<[u8; N]> {
        Vec::new()
    }
}

/// A record within a record: its own ranges.
pub(crate) struct Nested;

impl<T: Ranged> Rule<T> for Nested {
    fn check(&self, value: &T, _: Field) -> Result<(), RangeError> {
        value.check()
    }

    fn limit(&self, value: &mut T) {
        value.limit();
    }

    fn text(&self) -> Option<String> {
        None
    }

    #[cfg(test)]
    fn invalid(&self, valid: T) -> Vec<T> {
        valid.invalid().into_iter().map(|(_, record)| record).collect()
    }
}

/// Every element of an array.
pub(crate) struct Each<R>(pub(crate) R);

impl<T: Copy, R: Rule<T>, const N: usize> Rule<[T; N]> for Each<R> {
    fn check(&self, values: &[T; N], field: Field) -> Result<(), RangeError> {
        values.iter().try_for_each(|value| self.0.check(value, field))
    }

    fn limit(&self, values: &mut [T; N]) {
        values.iter_mut().for_each(|value| self.0.limit(value));
    }

    fn text(&self) -> Option<String> {
        self.0.text()
    }

    #[cfg(test)]
    fn invalid(&self, valid: [T; N]) -> Vec<[T; N]> {
        let last = N - 1;
        let with = |value| {
            let mut values = valid;
            values[last] = value;
            values
        };
        self.0.invalid(valid[last]).into_iter().map(with).collect()
    }
}

/// Declares the range of every field of a record.
macro_rules! ranges {
    ($record:ident as $name:literal { $($field:ident: $rule:expr,)* }) => {
        impl $crate::range::Ranged for $record {
            fn check(&self) -> Result<(), $crate::range::RangeError> {
                use $crate::range::{Field, Rule};
                let Self { $($field),* } = self;
                $($rule.check($field, Field { record: $name, name: stringify!($field) })?;)*
                Ok(())
            }

            fn limit(&mut self) {
                use $crate::range::Rule;
                let Self { $($field),* } = self;
                $($rule.limit($field);)*
            }

            fn texts() -> Vec<(&'static str, Option<String>)> {
                use $crate::range::text_of;
                vec![$((stringify!($field), text_of(&$rule, |record: &Self| &record.$field)),)*]
            }

            #[cfg(test)]
            fn invalid(self) -> Vec<(&'static str, Self)> {
                use $crate::range::Rule;
                let mut all = Vec::new();
                $(for value in $rule.invalid(self.$field) {
                    let mut record = self;
                    record.$field = value;
                    all.push((stringify!($field), record));
                })*
                all
            }
        }

        impl $record {
            /// The record with every number moved to the nearest valid one, for its writer: readers refuse a message
            /// with a number out of range. What is not a number stays.
            #[must_use]
            pub fn limited(mut self) -> Self {
                $crate::range::Ranged::limit(&mut self);
                self
            }
        }
    };
}
pub(crate) use ranges;

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Sample {
        count: u32,
        metres: f64,
        shares: [f32; 2],
        arrival_s: f64,
    }

    ranges! {
        Sample as "sample" {
            count: within(1, 3),
            metres: METRES,
            shares: Each(within(0.0_f32, 1.0)),
            arrival_s: within_or_infinite(0.0, 9.0),
        }
    }

    const VALID: Sample = Sample { count: 2, metres: 5.0, shares: [0.0, 1.0], arrival_s: f64::INFINITY };

    #[test]
    fn the_error_names_record_field_value_and_range() {
        assert_eq!(VALID.check(), Ok(()));
        let text = |sample: Sample| sample.check().unwrap_err().to_string();
        assert_eq!(text(Sample { count: 0, ..VALID }), "sample: count is 0, valid is 1 to 3");
        assert_eq!(text(Sample { metres: f64::NAN, ..VALID }), "sample: metres is NaN, valid is 0 to 10000");
        assert_eq!(text(Sample { metres: 1e13, ..VALID }), "sample: metres is 1e13, valid is 0 to 10000");
        assert_eq!(text(Sample { shares: [0.0, 1.5], ..VALID }), "sample: shares is 1.5, valid is 0 to 1");
    }

    #[test]
    fn every_invalid_value_is_refused_and_numbers_can_be_limited() {
        let all = VALID.invalid();
        for name in ["count", "metres", "shares", "arrival_s"] {
            assert!(all.iter().any(|(field, _)| *field == name), "{name}");
        }
        for (field, sample) in all {
            assert!(sample.check().is_err(), "{field}: {sample:?}");
            let is_nan = sample.metres.is_nan() || sample.shares[1].is_nan() || sample.arrival_s.is_nan();
            assert_eq!(sample.limited().check().is_ok(), !is_nan, "{field}: {sample:?}");
        }
        assert_eq!(VALID.limited(), VALID);
        let far = Sample { metres: 1e300, arrival_s: 10.0, ..VALID }.limited();
        assert_eq!((far.metres, far.arrival_s), (MAX_METRES, 9.0));
    }
}
