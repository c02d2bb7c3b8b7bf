//! Limits of networks.

/// Bytes of a file: two million weights.
pub const MAX_BYTES: u64 = 8 << 20;

/// Height and width of the input, in pixels.
pub const INPUT_PX: (usize, usize) = (8, 256);

/// Products for a look: some 50 ms on one core of a small board. It bounds the time without a clock, so that a recording
/// gives the same results on any machine.
pub const MAX_PRODUCTS: u64 = 100_000_000;

/// Versions of ONNX's operators that were compared.
pub const OPSETS: std::ops::RangeInclusive<i64> = 9..=25;
