//! The part of Protocol Buffers that recordings need: types as tables, messages written and read by
//! hand, and the descriptor that lets any other program decode them.

use std::fmt;

/// A message type.
#[derive(Debug)]
pub struct MessageType {
    /// With its package, as in `foxglove.RawImage`.
    pub name: &'static str,
    /// Its fields.
    pub fields: &'static [Field],
    /// The enum that is declared inside of it.
    pub nested: Option<&'static EnumType>,
}

/// An enum inside a message type.
#[derive(Debug)]
pub struct EnumType {
    /// Without the message's name.
    pub name: &'static str,
    /// Names in the order of their numbers, from 0.
    pub values: &'static [&'static str],
}

/// A field of a message type.
#[derive(Debug)]
pub struct Field {
    number: u32,
    name: &'static str,
    kind: FieldKind,
    is_repeated: bool,
}

/// What a field holds.
#[derive(Clone, Copy, Debug)]
pub enum FieldKind {
    /// A double.
    Double,
    /// A variable-length signed number of 64 bits.
    Int64,
    /// The same of 32 bits.
    Int32,
    /// Four bytes, unsigned.
    Fixed32,
    /// True or false.
    Bool,
    /// Text.
    Text,
    /// Bytes.
    Bytes,
    /// A message.
    Message(&'static MessageType),
    /// The enum of the message that the field is in.
    Enum,
}

/// A field that occurs once.
pub const fn one(number: u32, name: &'static str, kind: FieldKind) -> Field {
    Field { number, name, kind, is_repeated: false }
}

/// A field that may occur any number of times.
pub const fn many(number: u32, name: &'static str, kind: FieldKind) -> Field {
    Field { number, name, kind, is_repeated: true }
}

/// Writes a message, field by field.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    bytes: Vec<u8>,
}

impl Encoder {
    /// An empty message with room for `bytes` bytes.
    pub fn with_capacity(bytes: usize) -> Self {
        Self { bytes: Vec::with_capacity(bytes) }
    }

    /// The message.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }

    fn tag(&mut self, number: u32, wire: u64) {
        self.varint(u64::from(number) << 3 | wire);
    }

    /// A number of variable length, a truth value (0, 1) or an enum's number.
    pub fn number(&mut self, field: u32, value: u64) -> &mut Self {
        self.tag(field, 0);
        self.varint(value);
        self
    }

    /// Four bytes.
    pub fn fixed32(&mut self, field: u32, value: u32) -> &mut Self {
        self.tag(field, 5);
        self.bytes.extend_from_slice(&value.to_le_bytes());
        self
    }

    /// A double.
    pub fn double(&mut self, field: u32, value: f64) -> &mut Self {
        self.tag(field, 1);
        self.bytes.extend_from_slice(&value.to_le_bytes());
        self
    }

    /// Doubles of a repeated field, packed.
    pub fn doubles(&mut self, field: u32, values: &[f64]) -> &mut Self {
        self.tag(field, 2);
        self.varint(8 * values.len() as u64);
        values.iter().for_each(|v| self.bytes.extend_from_slice(&v.to_le_bytes()));
        self
    }

    /// Bytes.
    pub fn bytes(&mut self, field: u32, value: &[u8]) -> &mut Self {
        self.tag(field, 2);
        self.varint(value.len() as u64);
        self.bytes.extend_from_slice(value);
        self
    }

    /// Text.
    pub fn text(&mut self, field: u32, value: &str) -> &mut Self {
        self.bytes(field, value.as_bytes())
    }

    /// A message inside of this one.
    pub fn message(&mut self, field: u32, write: impl FnOnce(&mut Encoder)) -> &mut Self {
        let mut inner = Encoder::default();
        write(&mut inner);
        self.bytes(field, &inner.bytes)
    }
}

/// The bytes are no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotAMessage {
    /// Byte at which that was found.
    pub at: usize,
}

impl fmt::Display for NotAMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no Protocol Buffers message from byte {} on", self.at)
    }
}

/// The value of a field as it lies in the message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// A number of variable length.
    Number(u64),
    /// Eight bytes.
    Fixed64(u64),
    /// Four bytes.
    Fixed32(u32),
    /// Bytes, text, a message, or packed numbers.
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    /// Bytes; nothing for anything else.
    pub fn as_bytes(self) -> &'a [u8] {
        if let Value::Bytes(bytes) = self { bytes } else { &[] }
    }

    /// Text; nothing for anything else.
    pub fn as_text(self) -> &'a str {
        std::str::from_utf8(self.as_bytes()).unwrap_or("")
    }

    /// A whole number; 0 for anything else.
    pub fn as_number(self) -> u64 {
        match self {
            Value::Number(v) | Value::Fixed64(v) => v,
            Value::Fixed32(v) => v.into(),
            Value::Bytes(_) => 0,
        }
    }

    /// Packed doubles.
    pub fn as_doubles(self) -> Vec<f64> {
        let (chunks, _) = self.as_bytes().as_chunks::<8>();
        chunks.iter().map(|c| f64::from_le_bytes(*c)).collect()
    }
}

/// Reads a message field by field.
#[derive(Clone, Debug)]
pub struct Decoder<'a> {
    message: &'a [u8],
    at: usize,
}

impl<'a> Decoder<'a> {
    /// Reads from the start of a message.
    pub fn new(message: &'a [u8]) -> Self {
        Self { message, at: 0 }
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = *self.message.get(self.at)?;
            self.at += 1;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    fn take(&mut self, bytes: u64) -> Option<&'a [u8]> {
        let end = self.at.checked_add(usize::try_from(bytes).ok()?)?;
        let part = self.message.get(self.at..end)?;
        self.at = end;
        Some(part)
    }

    fn field(&mut self) -> Option<(u32, Value<'a>)> {
        let tag = self.varint()?;
        let value = match tag & 7 {
            0 => Value::Number(self.varint()?),
            1 => Value::Fixed64(u64::from_le_bytes(self.take(8)?.try_into().ok()?)),
            2 => {
                let bytes = self.varint()?;
                Value::Bytes(self.take(bytes)?)
            }
            5 => Value::Fixed32(u32::from_le_bytes(self.take(4)?.try_into().ok()?)),
            _ => return None,
        };
        Some((u32::try_from(tag >> 3).ok()?, value))
    }
}

impl<'a> Iterator for Decoder<'a> {
    type Item = Result<(u32, Value<'a>), NotAMessage>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.at >= self.message.len() {
            return None;
        }
        let at = self.at;
        let field = self.field();
        if field.is_none() {
            self.at = self.message.len();
        }
        Some(field.ok_or(NotAMessage { at }))
    }
}

/// The descriptor set of a type and of all types that it needs: what a recording holds as schema.
pub fn descriptor_set(root: &'static MessageType) -> Vec<u8> {
    let mut types = Vec::new();
    collect(root, &mut types);
    let mut set = Encoder::default();
    for message in types {
        set.message(1, |file| describe_file(file, message));
    }
    set.into_bytes()
}

/// A type's own needs come before it.
fn collect(message: &'static MessageType, found: &mut Vec<&'static MessageType>) {
    if found.iter().any(|m| m.name == message.name) {
        return;
    }
    for field in message.fields {
        if let FieldKind::Message(inner) = field.kind {
            collect(inner, found);
        }
    }
    if !found.iter().any(|m| m.name == message.name) {
        found.push(message);
    }
}

fn parts(message: &MessageType) -> (&'static str, &'static str) {
    message.name.rsplit_once('.').unwrap_or(("", message.name))
}

/// One file per type; its name is only a name.
fn file_name(message: &MessageType) -> String {
    let name = message.name.replace('.', "/");
    match name.strip_prefix("google/protobuf/") {
        Some(own) => format!("google/protobuf/{}.proto", own.to_ascii_lowercase()),
        None => format!("{name}.proto"),
    }
}

fn describe_file(file: &mut Encoder, message: &'static MessageType) {
    let (package, name) = parts(message);
    file.text(1, &file_name(message)).text(2, package);
    let mut needed: Vec<String> = Vec::new();
    for field in message.fields {
        if let FieldKind::Message(inner) = field.kind
            && !needed.contains(&file_name(inner))
        {
            needed.push(file_name(inner));
        }
    }
    needed.iter().for_each(|name| {
        file.text(3, name);
    });
    file.message(4, |descriptor| {
        descriptor.text(1, name);
        for field in message.fields {
            descriptor.message(2, |d| describe_field(d, message, field));
        }
        if let Some(nested) = message.nested {
            descriptor.message(4, |d| {
                d.text(1, nested.name);
                for (number, value) in nested.values.iter().enumerate() {
                    d.message(2, |v| {
                        v.text(1, value).number(2, number as u64);
                    });
                }
            });
        }
    });
    file.text(12, "proto3");
}

fn describe_field(d: &mut Encoder, message: &MessageType, field: &Field) {
    let kind = match field.kind {
        FieldKind::Double => 1,
        FieldKind::Int64 => 3,
        FieldKind::Int32 => 5,
        FieldKind::Fixed32 => 7,
        FieldKind::Bool => 8,
        FieldKind::Text => 9,
        FieldKind::Message(_) => 11,
        FieldKind::Bytes => 12,
        FieldKind::Enum => 14,
    };
    d.text(1, field.name).number(3, field.number.into());
    d.number(4, if field.is_repeated { 3 } else { 1 }).number(5, kind);
    match (field.kind, message.nested) {
        (FieldKind::Message(inner), _) => {
            d.text(6, &format!(".{}", inner.name));
        }
        (FieldKind::Enum, Some(nested)) => {
            d.text(6, &format!(".{}.{}", message.name, nested.name));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let mut encoder = Encoder::default();
        encoder.number(1, 300).fixed32(2, 7).double(3, -0.5).text(4, "grün");
        encoder.message(16, |inner| {
            inner.doubles(1, &[1.0, 2.0]);
        });
        let bytes = encoder.into_bytes();
        // The first field of the encoding's own documentation: 150 and 300 are 96 01 and ac 02.
        assert_eq!(bytes[..3], [0x08, 0xac, 0x02]);
        let fields: Vec<_> = Decoder::new(&bytes).collect::<Result<_, _>>().unwrap();
        assert_eq!(fields[0], (1, Value::Number(300)));
        assert_eq!(fields[1], (2, Value::Fixed32(7)));
        assert_eq!(fields[2], (3, Value::Fixed64((-0.5_f64).to_bits())));
        assert_eq!(fields[3].1.as_text(), "grün");
        let inner: Vec<_> = Decoder::new(fields[4].1.as_bytes()).collect::<Result<_, _>>().unwrap();
        assert_eq!((fields[4].0, inner[0].1.as_doubles()), (16, vec![1.0, 2.0]));
    }

    #[test]
    fn hostile_bytes_end_in_an_error() {
        for bytes in [&[0x80][..], &[0x0a, 5, 1], &[0x0a, 0xff, 0xff, 0xff, 0xff, 0x0f], &[0x0b], &[0xff; 20]]
        {
            assert!(Decoder::new(bytes).any(|field| field.is_err()), "{bytes:?}");
        }
        let mut random = fastrand::Rng::with_seed(5);
        for _ in 0..20_000 {
            let bytes: Vec<u8> = (0..random.usize(0..40)).map(|_| random.u8(..)).collect();
            // It ends, and every value lies within the bytes.
            assert!(Decoder::new(&bytes).count() <= bytes.len());
        }
    }
}
