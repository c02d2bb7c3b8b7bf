//! A signal: where a number is in the data of a frame, and how it is scaled. The notation is that of DBC files.

use super::frame::{FrameId, MAX_DATA_BYTES, MAX_EXTENDED_ID, MAX_STANDARD_ID};
use perception::excerpt::{VALUE_CHARS, excerpt};

/// Bit that DBC files set in the identifiers of extended frames.
const EXTENDED_BIT: u32 = 1 << 31;

/// Order of the bytes of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Little endian ("Intel", `@1`): the start is the least significant bit.
    Little,
    /// Big endian ("Motorola", `@0`): the start is the most significant bit.
    Big,
}

/// A number in the data of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// The frames that carry it.
    pub id: FrameId,
    /// Its start bit: bit `start % 8` of byte `start / 8`; which of its bits that is depends on the order.
    pub start: usize,
    /// Its length in bits, 1 to 64.
    pub length: usize,
    /// Order of its bytes.
    pub order: ByteOrder,
    /// Whether it is a two's complement number.
    pub is_signed: bool,
    /// Value of one step.
    pub factor: f64,
    /// Value of the number 0.
    pub offset: f64,
    /// Smallest and largest valid value, where the notation has them.
    pub range: Option<(f64, f64)>,
    /// Its unit; may be empty.
    pub unit: String,
}

impl Signal {
    /// Parses `id:start|length@order sign (factor,offset) [min|max] unit`; range and unit may be missing, and the unit
    /// may stand in quotes.
    ///
    /// # Errors
    /// The part that is wrong, and the remedy.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (id, layout) = text
            .split_once(':')
            .ok_or("no \":\" after the identifier: give id:start|length@order sign (factor,offset) unit")?;
        let id = id.trim();
        let number = match id.strip_prefix("0x").or_else(|| id.strip_prefix("0X")) {
            Some(digits) => u32::from_str_radix(digits, 16),
            None => id.parse(),
        };
        let number = number.map_err(|_| {
            format!("\"{}\" is no identifier: give a number such as 0x123", excerpt(id, VALUE_CHARS))
        })?;
        Self::of_layout(frame_id(number)?, layout)
    }

    /// Parses `start|length@order sign (factor,offset) [min|max] "unit"`; what follows a unit in quotes is left out.
    pub(super) fn of_layout(id: FrameId, text: &str) -> Result<Self, String> {
        let mut rest = text.trim();
        let start: usize = whole(part(&mut rest, '|')?, "start bit")?;
        let length: usize = whole(part(&mut rest, '@')?, "length")?;
        let (order, is_signed) = match rest.trim_start().as_bytes() {
            [order @ (b'0' | b'1'), sign @ (b'+' | b'-'), ..] => {
                rest = &rest.trim_start()[2..];
                (if *order == b'1' { ByteOrder::Little } else { ByteOrder::Big }, *sign == b'-')
            }
            _ => {
                return Err(
                    "after @: give 1 (little endian) or 0 (big endian), and + (unsigned) or - (signed)"
                        .into(),
                );
            }
        };
        part(&mut rest, '(')?;
        let factor = real(part(&mut rest, ',')?, "factor")?;
        let offset = real(part(&mut rest, ')')?, "offset")?;
        if factor == 0.0 {
            return Err("its factor is 0: give the value of one step".into());
        }
        rest = rest.trim_start();
        let mut range = None;
        if rest.starts_with('[') {
            part(&mut rest, '[')?;
            let (min, max) =
                (real(part(&mut rest, '|')?, "minimum")?, real(part(&mut rest, ']')?, "maximum")?);
            // DBC files write [0|0] where there is none.
            range = (min < max).then_some((min, max));
            rest = rest.trim_start();
        }
        let unit = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split('"').next().unwrap_or(""),
            None => rest,
        };
        let signal =
            Self { id, start, length, order, is_signed, factor, offset, range, unit: unit.trim().to_owned() };
        if length == 0 || length > 64 {
            return Err(format!("its length is {length} bits: give 1 to 64"));
        }
        match signal.bytes() {
            Some(_) => Ok(signal),
            None => Err(format!("it ends beyond byte {MAX_DATA_BYTES}: check start bit and byte order")),
        }
    }

    /// Number of bytes that a frame must have; `None` if no frame can.
    pub fn bytes(&self) -> Option<usize> {
        let last = match self.order {
            ByteOrder::Little => self.start.checked_add(self.length)? - 1,
            ByteOrder::Big => {
                // Bits of the first byte from the start down, then whole bytes.
                let first = self.start % 8 + 1;
                let more = self.length.saturating_sub(first).div_ceil(8);
                self.start.checked_add(8 * more)?
            }
        };
        Some(last / 8 + 1).filter(|&bytes| bytes <= MAX_DATA_BYTES)
    }

    /// Its value in the data of a frame, scaled; `None` if the frame is too short.
    pub fn decode(&self, data: &[u8]) -> Option<f64> {
        if self.bytes()? > data.len() {
            return None;
        }
        let bit = |at: usize| u64::from(data[at / 8] >> (at % 8) & 1);
        let mut raw = 0_u64;
        match self.order {
            ByteOrder::Little => {
                for i in (0..self.length).rev() {
                    raw = raw << 1 | bit(self.start + i);
                }
            }
            ByteOrder::Big => {
                let mut at = self.start;
                for _ in 0..self.length {
                    raw = raw << 1 | bit(at);
                    // Downwards in a byte, then to the highest bit of the next.
                    at = if at.is_multiple_of(8) { at + 15 } else { at - 1 };
                }
            }
        }
        let number = if self.is_signed {
            let shift = 64 - self.length;
            ((raw << shift).cast_signed() >> shift) as f64
        } else {
            raw as f64
        };
        Some(number * self.factor + self.offset)
    }

    /// Whether it can have no value below zero.
    pub fn is_unsigned(&self) -> bool {
        !self.is_signed && self.factor > 0.0 && self.offset >= 0.0
    }

    /// Whether a value is within the range of the notation, if it has one.
    pub fn is_valid(&self, value: f64) -> bool {
        // Factors such as 0.01 are not exact: a part of a step is allowed.
        let slack = self.factor.abs() * 0.01;
        self.range.is_none_or(|(min, max)| (min - slack..=max + slack).contains(&value))
    }
}

/// The identifier that a number in DBC's notation means: bit 31 or more than 11 bits make it extended.
pub(super) fn frame_id(number: u32) -> Result<FrameId, String> {
    let is_extended = number & EXTENDED_BIT != 0 || number > MAX_STANDARD_ID;
    let id = FrameId { number: number & !EXTENDED_BIT, is_extended };
    if id.number > MAX_EXTENDED_ID {
        return Err(format!("the identifier {number:#x} has more than 29 bits"));
    }
    Ok(id)
}

/// What stands before `end`, which is removed with it.
fn part<'a>(rest: &mut &'a str, end: char) -> Result<&'a str, String> {
    let (before, after) = rest.split_once(end).ok_or_else(|| {
        format!(
            "no \"{end}\" in \"{}\": give start|length@order sign (factor,offset) [min|max] unit",
            excerpt(rest, VALUE_CHARS)
        )
    })?;
    *rest = after;
    Ok(before.trim())
}

fn whole(word: &str, name: &str) -> Result<usize, String> {
    word.parse().map_err(|_| format!("its {name} \"{}\" is not a whole number", excerpt(word, VALUE_CHARS)))
}

fn real(word: &str, name: &str) -> Result<f64, String> {
    let value = word.parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| format!("its {name} \"{}\" is not a number", excerpt(word, VALUE_CHARS)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(layout: &str) -> Signal {
        Signal::parse(&format!("0x10:{layout}")).unwrap()
    }

    /// Expected values from cantools 45.1 (`decode_message` of a database with these signals), which has an independent
    /// implementation.
    const EXPECTED: &[(&str, [u8; 8], f64)] = &include!("cantools_values.in");

    #[test]
    fn values_are_those_of_cantools() {
        for (layout, data, expected) in EXPECTED {
            let value = signal(layout).decode(data).unwrap();
            assert!(
                (value - expected).abs() <= 1e-9 * expected.abs().max(1.0),
                "{layout} {data:x?}: {value}, not {expected}"
            );
        }
        assert!(EXPECTED.len() >= 60);
    }

    /// The reverse of [`Signal::decode`], by a table of bits.
    fn encode(signal: &Signal, raw: u64, data: &mut [u8]) {
        let mut place = signal.start;
        for i in 0..signal.length {
            let (at, bit) = match signal.order {
                ByteOrder::Little => (signal.start + i, raw >> i & 1),
                ByteOrder::Big => {
                    let here = place;
                    place = if here.is_multiple_of(8) { here + 15 } else { here - 1 };
                    (here, raw >> (signal.length - 1 - i) & 1)
                }
            };
            data[at / 8] = data[at / 8] & !(1 << (at % 8)) | (bit as u8) << (at % 8);
        }
    }

    #[test]
    fn random_signals_come_back() {
        let mut random = fastrand::Rng::with_seed(20);
        let mut fitting = 0;
        while fitting < 5000 {
            let (order, sign) = (random.u8(0..2), if random.bool() { '+' } else { '-' });
            let layout = format!("{}|{}@{order}{sign} (1,0)", random.usize(0..64), random.usize(1..53));
            let signal = signal(&layout);
            let bytes = signal.bytes().unwrap();
            if bytes > 8 {
                continue;
            }
            fitting += 1;
            let mut data = [0; 8];
            random.fill(&mut data);
            let raw = random.u64(..) & ((1 << signal.length) - 1);
            encode(&signal, raw, &mut data);
            let is_negative = signal.is_signed && raw >> (signal.length - 1) == 1;
            let expected = raw as f64 - if is_negative { (1_u64 << signal.length) as f64 } else { 0.0 };
            assert_eq!(signal.decode(&data), Some(expected), "{layout} {data:x?}");
            assert!(signal.decode(&data[..bytes]).is_some());
            assert_eq!(signal.decode(&data[..bytes - 1]), None, "{layout}");
        }
    }

    #[test]
    fn notations_are_read() {
        let full = Signal::parse("0x18FEF100 : 7|16@0- (0.5,-10) [-100|200.5] \"km/h\" Node1,Node2").unwrap();
        assert_eq!(full.id, FrameId { number: 0x18fe_f100, is_extended: true });
        assert_eq!((full.start, full.length, full.order, full.is_signed), (7, 16, ByteOrder::Big, true));
        assert_eq!((full.factor, full.offset, full.range), (0.5, -10.0, Some((-100.0, 200.5))));
        assert_eq!(full.unit, "km/h");
        let short = Signal::parse("291:8|16@1+(0.01,0) km/h").unwrap();
        assert_eq!(
            (short.id.number, short.id.is_extended, short.range, short.unit.as_str()),
            (0x123, false, None, "km/h")
        );
        // Bit 31 marks an extended identifier that would fit a standard one.
        assert!(Signal::parse("0x80000123:0|8@1+ (1,0)").unwrap().id.is_extended);
        assert!(short.is_unsigned() && !full.is_unsigned());
        assert!(full.is_valid(200.5) && !full.is_valid(201.0) && short.is_valid(1e9));
    }

    #[test]
    fn faults_of_a_notation_are_named() {
        for (text, expected) in [
            ("8|16@1+ (1,0)", "no \":\" after the identifier"),
            ("speed:8|16@1+ (1,0)", "\"speed\" is no identifier"),
            ("0x20000000:0|8@1+ (1,0)", "more than 29 bits"),
            ("1:8@1+ (1,0)", "no \"|\" in"),
            ("1:a|8@1+ (1,0)", "its start bit \"a\" is not a whole number"),
            ("1:0|-1@1+ (1,0)", "its length \"-1\""),
            ("1:0|0@1+ (1,0)", "its length is 0 bits"),
            ("1:0|65@1+ (1,0)", "its length is 65 bits"),
            ("1:0|8@2+ (1,0)", "after @: give 1"),
            ("1:0|8@1 (1,0)", "after @: give 1"),
            ("1:0|8@1+ 1,0", "no \"(\" in"),
            ("1:0|8@1+ (x,0)", "its factor \"x\""),
            ("1:0|8@1+ (0,0)", "its factor is 0"),
            ("1:0|8@1+ (1,inf)", "its offset \"inf\""),
            ("1:510|8@1+ (1,0)", "beyond byte 64"),
            ("1:504|16@0+ (1,0)", "beyond byte 64"),
            ("1:18446744073709551615|8@1+ (1,0)", "beyond byte 64"),
            ("1:18446744073709551615|64@0+ (1,0)", "beyond byte 64"),
            ("1:0|8@1+ (1,0) [1|", "no \"]\" in"),
        ] {
            let error = Signal::parse(text).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
