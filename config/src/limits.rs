//! What the reader of configurations takes at most. A file beyond it is refused before it is read or parsed: it is no
//! configuration, and memory and time grow with it. Nesting is limited to 80 levels by the TOML parser.

/// Bytes of a file. All keys with all their descriptions take 40 KiB.
pub const MAX_BYTES: u64 = 256 << 10;

/// Errors that are reported at once. Each costs a search for its line and for the nearest name.
pub const MAX_ERRORS: usize = 100;

/// Characters of an unknown name for which the nearest known one is searched: twice the longest key. The time grows with
/// the product of both lengths.
pub const MAX_SUGGESTED_CHARS: usize = 64;

/// Bytes of a path: Linux's `PATH_MAX` without the terminating zero.
pub const MAX_PATH_BYTES: usize = 4095;
