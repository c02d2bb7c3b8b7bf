//! Checksum and alive counter of a frame: AUTOSAR E2E profile 1, variant 1A.
//!
//! The profile is that of AUTOSAR's "Specification of SW-C End-to-End Communication Protection Library": byte 0 is a
//! CRC-8 with the polynomial of SAE J1850 (0x1D), but with start value and final XOR 0; it covers the 16-bit data id (low
//! byte, high byte), which is not sent, and then bytes 1 to 7. The low half of byte 1 is a counter from 0 to 14.

/// Number of values of the alive counter, 0 to 14: 15 is invalid in the profile.
pub const COUNTER_VALUES: u8 = 15;

/// Polynomial of SAE J1850, without its highest power.
const POLYNOMIAL: u8 = 0x1d;

/// Checksums of single bytes.
const TABLE: [u8; 256] = {
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        let mut crc = i as u8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ POLYNOMIAL };
            bit += 1;
        }
        table[i] = crc;
        i += 1;
    }
    table
};

/// The checksum of a frame: over its data id and its bytes 1 to 7.
pub fn checksum(data: &[u8; 8], data_id: u16) -> u8 {
    let id = data_id.to_le_bytes();
    id.iter().chain(&data[1..]).fold(0, |crc, byte| TABLE[usize::from(crc ^ byte)])
}

/// Whether byte 0 of a frame is its checksum and the counter is a valid one: what a receiver tests.
pub fn is_intact(data: &[u8; 8], data_id: u16) -> bool {
    data[0] == checksum(data, data_id) && data[1] & 0xf < COUNTER_VALUES
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checksums of `autosar-e2e` 1.0 for Python (`e2e.p01.e2e_p01_protect`, both bytes of the data id), an independent
    /// implementation: data from byte 1 on, data id, checksum.
    const EXPECTED: &[([u8; 7], u16, u8)] = &include!("e2e_values.in");

    #[test]
    fn checksums_are_those_of_an_independent_implementation() {
        assert!(EXPECTED.len() >= 20);
        for (rest, data_id, expected) in EXPECTED {
            let mut data = [0; 8];
            data[1..].copy_from_slice(rest);
            assert_eq!(checksum(&data, *data_id), *expected, "{rest:x?} {data_id:#x}");
        }
    }

    #[test]
    fn every_single_wrong_bit_is_found() {
        let mut data = [0, 0x23, 0x45, 0x67, 0x89, 0xab, 0xcd, 0xef];
        data[0] = checksum(&data, 0x4c05);
        assert!(is_intact(&data, 0x4c05));
        assert!(!is_intact(&data, 0x4c06) && !is_intact(&data, 0x4d05), "another message's frame");
        for bit in 0..64 {
            let mut wrong = data;
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_intact(&wrong, 0x4c05), "bit {bit}");
        }
    }

    #[test]
    fn the_counter_15_is_invalid() {
        let mut data = [0, 0xf, 0, 0, 0, 0, 0, 0];
        data[0] = checksum(&data, 1);
        assert!(!is_intact(&data, 1));
    }
}
