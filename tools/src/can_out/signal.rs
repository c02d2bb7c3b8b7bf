//! A signal of a frame that is sent: where its bits are, what they mean, and which value they take.

/// What the bits of a signal mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    /// A physical value: raw × factor + offset. A value beyond the range is sent as its nearest end (so is an infinite
    /// one); all ones mean "not available".
    Number {
        /// Value of one step.
        factor: f64,
        /// Value of raw 0.
        offset: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// One of several states, by its index; all ones mean "not available".
    State(&'static [&'static str]),
    /// One bit: 1 = yes. Without a value it is 0.
    Bit,
    /// The low bits of a count or an identifier. Without a value it is 0.
    LowBits,
}

/// One signal of a message whose values come from a `T`. All signals are little endian ("Intel") and unsigned.
#[derive(Clone, Copy, Debug)]
pub struct Signal<T> {
    /// Its name, without the prefix of its message.
    pub name: &'static str,
    /// Place of its lowest bit: bit `start % 8` of byte `start / 8`.
    pub start: u32,
    /// Number of its bits, at most 16.
    pub length: u32,
    /// What the bits mean.
    pub coding: Coding,
    /// Description, for the DBC file.
    pub text: &'static str,
    /// Its value; `None` while there is none.
    pub value: fn(&T) -> Option<f64>,
}

impl<T> Signal<T> {
    /// The raw number that means "not available", if the signal has one.
    pub fn not_available(&self) -> Option<u64> {
        match self.coding {
            Coding::Number { .. } | Coding::State(_) => Some(self.mask()),
            Coding::Bit | Coding::LowBits => None,
        }
    }

    /// The largest raw number that is a value.
    pub fn max_raw(&self) -> u64 {
        match self.coding {
            Coding::Number { .. } => self.mask() - 1,
            Coding::State(names) => names.len() as u64 - 1,
            Coding::Bit | Coding::LowBits => self.mask(),
        }
    }

    /// Smallest and largest value.
    pub fn range(&self) -> (f64, f64) {
        match self.coding {
            Coding::Number { factor, offset, .. } => (offset, offset + factor * self.max_raw() as f64),
            _ => (0.0, self.max_raw() as f64),
        }
    }

    /// The raw number for a subject; "not available" without one.
    pub fn raw(&self, of: Option<&T>) -> u64 {
        let value = of.and_then(|of| (self.value)(of)).filter(|value| !value.is_nan());
        match (value, self.coding) {
            (None, _) => self.not_available().unwrap_or(0),
            (Some(value), Coding::Number { factor, offset, .. }) => {
                // The conversion of a float saturates, so infinities and large values are clamped, too.
                (((value - offset) / factor).round() as u64).min(self.max_raw())
            }
            (Some(value), Coding::State(names)) => {
                if value >= 0.0 && value < names.len() as f64 {
                    value as u64
                } else {
                    self.mask()
                }
            }
            (Some(value), Coding::Bit | Coding::LowBits) => value as u64 & self.mask(),
        }
    }

    /// Puts the raw number for a subject into a frame.
    pub fn encode(&self, of: Option<&T>, data: &mut [u8; 8]) {
        let place = self.mask() << self.start;
        let others = u64::from_le_bytes(*data) & !place;
        *data = (others | self.raw(of) << self.start & place).to_le_bytes();
    }

    /// All ones.
    fn mask(&self) -> u64 {
        (1 << self.length) - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISTANCE: Signal<Option<f64>> = Signal {
        name: "Distance",
        start: 12,
        length: 12,
        coding: Coding::Number { factor: 0.05, offset: -10.0, unit: "m" },
        text: "",
        value: |value| *value,
    };

    #[test]
    fn numbers_are_rounded_and_saturate_and_have_a_code_for_no_value() {
        let raw = |value: f64| DISTANCE.raw(Some(&Some(value)));
        assert_eq!((raw(-10.0), raw(0.0), raw(0.024), raw(0.026)), (0, 200, 200, 201));
        assert_eq!((raw(-10.1), raw(-1e300), raw(f64::NEG_INFINITY)), (0, 0, 0));
        assert_eq!((raw(194.7), raw(194.75), raw(1e300), raw(f64::INFINITY)), (4094, 4094, 4094, 4094));
        assert_eq!((DISTANCE.raw(None), DISTANCE.raw(Some(&None)), raw(f64::NAN)), (4095, 4095, 4095));
        assert_eq!(DISTANCE.range().0, -10.0);
        assert!((DISTANCE.range().1 - 194.7).abs() < 1e-9);
    }

    #[test]
    fn states_bits_and_counts() {
        let state = Signal { length: 3, coding: Coding::State(&["off", "clear"]), ..DISTANCE };
        let raw = |value: f64| state.raw(Some(&Some(value)));
        assert_eq!((raw(0.0), raw(1.0), raw(2.0), raw(-1.0), state.raw(None)), (0, 1, 7, 7, 7));
        let bit = Signal { length: 1, coding: Coding::Bit, ..DISTANCE };
        assert_eq!((bit.raw(Some(&Some(1.0))), bit.raw(None)), (1, 0));
        let count = Signal { length: 8, coding: Coding::LowBits, ..DISTANCE };
        assert_eq!((count.raw(Some(&Some(259.0))), count.raw(None)), (3, 0));
    }

    #[test]
    fn a_signal_changes_its_own_bits_only() {
        for ones in [0, 0xff] {
            let mut data = [ones; 8];
            DISTANCE.encode(Some(&Some(0.0)), &mut data);
            let read = u64::from_le_bytes(data);
            assert_eq!(read >> 12 & 0xfff, 200);
            assert_eq!(read & !(0xfff << 12), if ones == 0 { 0 } else { u64::MAX & !(0xfff << 12) });
        }
    }
}
