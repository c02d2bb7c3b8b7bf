//! Validation of the lengths inside MCAP records before the `mcap` crate parses them: with a damaged length
//! it would request any amount of memory, and the program would abort.

use mcap::records::op;

/// The part of a record that was not read yet.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(taken)
    }

    /// Bytes that their length precedes as a `u32`.
    fn run(&mut self) -> Option<&'a [u8]> {
        let length = u32::from_le_bytes(self.take(4)?.try_into().ok()?);
        self.take(usize::try_from(length).ok()?)
    }

    /// Bytes that their length precedes as a `u64`.
    fn long_run(&mut self) -> Option<&'a [u8]> {
        let length = u64::from_le_bytes(self.take(8)?.try_into().ok()?);
        self.take(usize::try_from(length).ok()?)
    }

    /// A map of strings.
    fn map(&mut self) -> Option<()> {
        let mut pairs = Rest(self.run()?);
        while !pairs.0.is_empty() {
            pairs.run()?;
            pairs.run()?;
        }
        Some(())
    }
}

/// Whether all lengths in a record stay within it. Records without lengths, and records whose contents are
/// never read, pass.
pub fn fit(opcode: u8, body: &[u8]) -> bool {
    walk(opcode, &mut Rest(body)).is_some()
}

fn walk(opcode: u8, rest: &mut Rest<'_>) -> Option<()> {
    match opcode {
        // Id; name, encoding, data.
        op::SCHEMA => {
            rest.take(2)?;
            rest.run()?;
            rest.run()?;
            rest.run()?;
        }
        // Id, schema; topic, encoding, metadata.
        op::CHANNEL => {
            rest.take(4)?;
            rest.run()?;
            rest.run()?;
            rest.map()?;
        }
        // Times of the first and last message, size, checksum; compression, records.
        op::CHUNK => {
            rest.take(28)?;
            rest.run()?;
            rest.long_run()?;
        }
        // Channel; entries.
        op::MESSAGE_INDEX => {
            rest.take(2)?;
            rest.run()?;
        }
        // Name, pairs.
        op::METADATA => {
            rest.run()?;
            rest.map()?;
        }
        _ => {}
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
    }

    #[test]
    fn a_length_beyond_the_record_is_found_wherever_it_is() {
        let pairs = [text("key"), text("value")].concat();
        let map = [&(pairs.len() as u32).to_le_bytes()[..], &pairs].concat();
        let chunk = [vec![0; 28], text("lz4"), 3_u64.to_le_bytes().to_vec(), vec![1, 2, 3]].concat();
        let records = [
            (op::SCHEMA, [vec![1, 0], text("a"), text("protobuf"), text("data")].concat(), vec![2, 7, 19]),
            (
                op::CHANNEL,
                [vec![1, 0, 1, 0], text("/t"), text("cdr"), map.clone()].concat(),
                vec![4, 10, 17, 21, 28],
            ),
            (op::CHUNK, chunk, vec![28, 35]),
            (op::MESSAGE_INDEX, [vec![1, 0], text("sixteen bytes...")].concat(), vec![2]),
            (op::METADATA, [text("about"), map].concat(), vec![0, 9, 13, 20]),
        ];
        for (opcode, body, places) in records {
            assert!(fit(opcode, &body), "{opcode}");
            for place in places {
                let mut damaged = body.clone();
                damaged[place + 3] = 0x73;
                assert!(!fit(opcode, &damaged), "{opcode}, byte {place}");
            }
            assert!(!fit(opcode, &body[..body.len() - 1]), "{opcode}, cut off");
        }
        assert!(fit(op::MESSAGE, &[1]) && !fit(op::CHUNK, &[]));
    }
}
