//! Changes of binary formats that keep lengths and checksums right: chunks of PNG, segments of JPEG, records of MCAP,
//! headers of PNM and PFM.

use super::structure;
use fastrand::Rng;

/// Bytes of the magic of PNG, and of MCAP at both ends.
const MAGIC: usize = 8;

/// Drops, doubles, swaps, takes over or changes pieces; the first and the last are moved seldom.
fn shuffle(
    random: &mut Rng,
    all: &mut Vec<Vec<u8>>,
    others: &[Vec<u8>],
    change: impl Fn(&mut Rng, &mut Vec<u8>),
) {
    if all.is_empty() || others.is_empty() {
        return;
    }
    let (a, b) = (random.usize(0..all.len()), random.usize(0..all.len()));
    match random.u8(0..10) {
        0 => drop(all.remove(a)),
        1 => all.insert(b, all[a].clone()),
        2 => all.swap(a, b),
        3 => all.insert(a, others[random.usize(0..others.len())].clone()),
        _ => change(random, &mut all[a]),
    }
}

/// Changes one byte or one number of a body.
fn body(random: &mut Rng, bytes: &mut [u8]) {
    if bytes.is_empty() {
        return;
    }
    let at = random.usize(0..bytes.len());
    match random.u8(0..3) {
        0 => bytes[at] ^= 1 << random.u8(0..8),
        1 => bytes[at] = random.u8(..),
        _ => bytes[at] = [0, 1, 2, 255][random.usize(0..4)],
    }
}

/// CRC-32 as PNG has it.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    })
}

/// The chunks of a PNG: kind and data.
fn chunks(png: &[u8]) -> Vec<Vec<u8>> {
    let mut rest = png.get(MAGIC..).unwrap_or(&[]);
    let mut chunks = Vec::new();
    while let Some((head, after)) = rest.split_at_checked(4) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some((chunk, after)) = length.checked_add(4).and_then(|n| after.split_at_checked(n)) else {
            break;
        };
        chunks.push(chunk.to_vec());
        rest = after.get(4..).unwrap_or(&[]);
    }
    chunks
}

fn png(random: &mut Rng, input: &mut Vec<u8>, other: &[u8]) {
    let mut all = chunks(input);
    shuffle(random, &mut all, &chunks(other), |random, chunk| {
        let from = 4.min(chunk.len());
        body(random, &mut chunk[from..]);
    });
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    for chunk in all {
        out.extend((chunk.len() as u32 - 4).to_be_bytes());
        out.extend(&chunk);
        out.extend(crc(&chunk).to_be_bytes());
    }
    *input = out;
}

/// The segments of a JPEG, each with its marker; the coded pixels belong to the last.
fn segments(jpeg: &[u8]) -> Vec<Vec<u8>> {
    let mut rest = jpeg.get(2..).unwrap_or(&[]);
    let mut segments = Vec::new();
    while rest.len() >= 4 && rest[0] == 0xff && rest[1] != 0xda {
        let length = 2 + usize::from(u16::from_be_bytes([rest[2], rest[3]]));
        let Some((segment, after)) = rest.split_at_checked(length) else { break };
        segments.push(segment.to_vec());
        rest = after;
    }
    segments.push(rest.to_vec());
    segments
}

fn jpeg(random: &mut Rng, input: &mut Vec<u8>, other: &[u8]) {
    let mut all = segments(input);
    shuffle(random, &mut all, &segments(other), |random, segment| {
        let from = 4.min(segment.len());
        body(random, &mut segment[from..]);
    });
    *input = [vec![0xff, 0xd8], all.concat()].concat();
}

/// Changes an image of any format.
pub fn picture(random: &mut Rng, input: &mut Vec<u8>, other: &[u8]) {
    match input.get(..2) {
        Some([0x89, b'P']) => png(random, input, other),
        Some([0xff, 0xd8]) => jpeg(random, input, other),
        _ => {
            // PNM and PFM: the head is text.
            let end = input.len().min(20);
            let mut head: Vec<u8> = input.drain(..end).collect();
            match random.u8(0..3) {
                0 => structure::number(random, &mut head),
                1 => body(random, input),
                _ => input.truncate(input.len() - input.len().min(random.usize(0..3))),
            }
            input.splice(0..0, head);
        }
    }
}

/// The records of an MCAP file, each with its head of 9 bytes.
fn records(file: &[u8]) -> Vec<Vec<u8>> {
    let mut rest = file.get(MAGIC..).unwrap_or(&[]);
    let mut records = Vec::new();
    while rest.len() >= 9 {
        let length = u64::from_le_bytes(rest[1..9].try_into().unwrap_or_default());
        let length = usize::try_from(length).ok().and_then(|n| n.checked_add(9));
        let Some((record, after)) = length.and_then(|n| rest.split_at_checked(n)) else { break };
        records.push(record.to_vec());
        rest = after;
    }
    records
}

/// Changes a recording record by record.
pub fn recording(random: &mut Rng, input: &mut Vec<u8>, other: &[u8]) {
    let magic = b"\x89MCAP0\r\n";
    let mut all = records(input);
    shuffle(random, &mut all, &records(other), |random, record| {
        let from = 9.min(record.len());
        body(random, &mut record[from..]);
    });
    *input = [magic.to_vec(), all.concat(), magic.to_vec()].concat();
}
