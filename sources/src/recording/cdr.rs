//! CDR (Common Data Representation), the encoding of ROS 2 messages: the types that images and calibrations use.

/// Reads the fields of a message in order.
pub struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Cdr<'a> {
    /// A reader behind the encapsulation header of four bytes; `None` for encodings other than plain CDR.
    pub fn new(message: &'a [u8]) -> Option<Self> {
        let (head, body) = message.split_at_checked(4)?;
        (head[0] == 0 && head[1] <= 1).then_some(Self { body, at: 0, is_little: head[1] == 1 })
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        // Numbers are aligned to their size.
        self.at = self.at.next_multiple_of(N);
        let bytes: [u8; N] = self.body.get(self.at..self.at.checked_add(N)?)?.try_into().ok()?;
        self.at += N;
        Some(bytes)
    }

    /// An unsigned integer of one byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.take::<1>().map(|[b]| b)
    }

    /// An unsigned integer of four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        let bytes = self.take()?;
        Some(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// A floating-point number of eight bytes.
    pub fn f64(&mut self) -> Option<f64> {
        let bytes = self.take()?;
        Some(if self.is_little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    }

    /// A sequence of bytes, which its length precedes.
    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()? as usize;
        let bytes = self.body.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(bytes)
    }

    /// A string, without its terminating zero.
    pub fn text(&mut self) -> Option<&'a str> {
        let bytes = self.bytes()?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }

    /// Skips a `std_msgs/msg/Header`.
    pub fn header(&mut self) -> Option<()> {
        self.u32()?;
        self.u32()?;
        self.text().map(|_| ())
    }
}
