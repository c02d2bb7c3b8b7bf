//! CDR, the serialisation of ROS 2 (plain CDR of version 1, little-endian): each number is aligned to its size, counted from
//! the end of the encapsulation header.

/// Encapsulation header: plain CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// A message that is being written.
#[derive(Clone, Debug)]
pub struct Cdr(Vec<u8>);

impl Default for Cdr {
    fn default() -> Self {
        Self(HEADER.to_vec())
    }
}

impl Cdr {
    /// The serialised message.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }

    fn align(&mut self, bytes: usize) {
        let length = (self.0.len() - HEADER.len()).next_multiple_of(bytes) + HEADER.len();
        self.0.resize(length, 0);
    }

    /// A byte, also a truth value.
    pub fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    /// An unsigned number of 32 bits, also the length of a sequence.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// A signed number of 32 bits.
    pub fn i32(&mut self, value: i32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// A number of single precision.
    pub fn f32(&mut self, value: f32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// Numbers of double precision, without a length: one, or an array of fixed length.
    pub fn f64(&mut self, values: &[f64]) {
        self.align(8);
        values.iter().for_each(|value| self.0.extend_from_slice(&value.to_le_bytes()));
    }

    /// A text; it ends with a zero, which counts.
    pub fn text(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }

    /// A sequence of bytes.
    pub fn bytes(&mut self, length: usize, bytes: impl IntoIterator<Item = u8>) {
        self.length(length);
        let end = self.0.len() + length;
        self.0.extend(bytes.into_iter().take(length));
        self.0.resize(end, 0);
    }

    /// The length of a sequence that follows.
    pub fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).unwrap_or(u32::MAX));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_after_the_header() {
        let mut cdr = Cdr::default();
        cdr.u8(7);
        cdr.u32(1);
        cdr.f64(&[1.0]);
        cdr.text("ab");
        cdr.i32(-1);
        cdr.bytes(2, [9, 8]);
        let expected = [
            &[0, 1, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0][..],
            &1.0_f64.to_le_bytes(),
            &[3, 0, 0, 0, b'a', b'b', 0, 0, 255, 255, 255, 255, 2, 0, 0, 0, 9, 8],
        ];
        assert_eq!(cdr.finish(), expected.concat());
    }
}
