//! CDR, the encoding of ROS 2 messages: as much as images and calibrations need.

/// Reads the fields of a message one after the other.
pub struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Cdr<'a> {
    /// Reads behind the four bytes that tell the encoding; `None` when it is another than plain CDR.
    pub fn new(message: &'a [u8]) -> Option<Self> {
        let (head, body) = message.split_at_checked(4)?;
        (head[0] == 0 && head[1] <= 1).then_some(Self { body, at: 0, is_little: head[1] == 1 })
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        // Numbers lie at multiples of their size.
        self.at = self.at.next_multiple_of(N);
        let bytes: [u8; N] = self.body.get(self.at..self.at.checked_add(N)?)?.try_into().ok()?;
        self.at += N;
        Some(bytes)
    }

    /// A byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.take::<1>().map(|[b]| b)
    }

    /// A number of four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        let bytes = self.take()?;
        Some(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// A double.
    pub fn f64(&mut self) -> Option<f64> {
        let bytes = self.take()?;
        Some(if self.is_little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    }

    /// Bytes with their count before them.
    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()? as usize;
        let bytes = self.body.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(bytes)
    }

    /// Text with its terminating zero.
    pub fn text(&mut self) -> Option<&'a str> {
        let bytes = self.bytes()?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }

    /// A `std_msgs/msg/Header`: passed over.
    pub fn header(&mut self) -> Option<()> {
        self.u32()?;
        self.u32()?;
        self.text().map(|_| ())
    }
}
