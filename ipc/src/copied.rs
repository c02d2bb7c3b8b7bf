//! Copies out of memory that another process may write.
//!
//! A record is copied once, and the copy is checked and used: a change in shared memory after the check has no
//! effect. See [`crate::port`] for what is relied on.

use bytemuck::Pod;
use std::ops::Deref;

/// The bytes of a record at any address.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct Unaligned<T>(T);

/// Copies a record from the start of `bytes`, reading memory once; `None` if they are too short.
pub(crate) fn copy_out<T: Pod>(bytes: &[u8]) -> Option<T> {
    let bytes = bytes.get(..size_of::<T>())?;
    // SAFETY: the slice is as long as the record, every address is aligned for a packed structure, and every bit
    // pattern is a valid `Pod`. The read is volatile: the compiler may not read the memory again later, when another
    // process may have changed it, in place of the copy.
    let copy = unsafe { std::ptr::read_volatile(bytes.as_ptr().cast::<Unaligned<T>>()) };
    Some(copy.0)
}

/// Up to `N` records that were copied out of a message.
#[derive(Clone, Copy, Debug)]
pub struct Records<T, const N: usize> {
    all: [T; N],
    count: usize,
}

impl<T: Pod, const N: usize> Records<T, N> {
    /// Copies the records that fill `bytes`, at most `N`; the rest of a record is ignored.
    pub(crate) fn copy_out(bytes: &[u8]) -> Self {
        let mut records = Self::default();
        for (to, from) in records.all.iter_mut().zip(bytes.chunks_exact(size_of::<T>())) {
            if let Some(record) = copy_out(from) {
                *to = record;
                records.count += 1;
            }
        }
        records
    }
}

/// No records.
impl<T: Pod, const N: usize> Default for Records<T, N> {
    fn default() -> Self {
        Self { all: [T::zeroed(); N], count: 0 }
    }
}

impl<T, const N: usize> Deref for Records<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.all[..self.count]
    }
}

impl<'a, T, const N: usize> IntoIterator for &'a Records<T, N> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_copied_from_any_address_and_bounded() {
        let bytes: Vec<u8> = (0..41).collect();
        assert_eq!(copy_out::<u32>(&bytes[1..]), Some(u32::from_ne_bytes([1, 2, 3, 4])));
        assert_eq!(copy_out::<u64>(&bytes[..7]), None);
        let records: Records<[u8; 10], 3> = Records::copy_out(&bytes[1..]);
        assert_eq!(records.len(), 3);
        assert_eq!(records[2][0], 21);
        assert_eq!(Records::<[u8; 10], 8>::copy_out(&bytes).len(), 4);
        assert!(Records::<u64, 2>::copy_out(&[]).is_empty());
    }
}
