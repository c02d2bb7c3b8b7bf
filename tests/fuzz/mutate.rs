//! Mutates inputs: bits and bytes, numbers and fields, lines and pieces of other inputs.

use fastrand::Rng;

/// Numbers at the limits of types and ranges.
const NUMBERS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "-0.0",
    "nan",
    "inf",
    "-inf",
    "1e309",
    "1e-320",
    "127",
    "255",
    "256",
    "65535",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967296",
    "9223372036854775807",
    "18446744073709551616",
    "0.1",
    "1e9",
    "-1e9",
];

/// Bytes that mean something to one reader or another.
const BYTES: [u8; 16] = [0, 1, 9, 10, 13, 32, 34, 35, 45, 60, 91, 93, 0x7f, 0x80, 0xfe, 0xff];

/// A changed copy of one of the inputs, at most `longest` bytes.
pub fn mutate(random: &mut Rng, corpus: &[Vec<u8>], longest: usize) -> Vec<u8> {
    let mut input = corpus[random.usize(0..corpus.len())].clone();
    let most = 1 << random.u8(0..5);
    for _ in 0..1 + random.usize(0..most) {
        change(random, &mut input, corpus);
    }
    input.truncate(longest);
    input
}

fn change(random: &mut Rng, input: &mut Vec<u8>, corpus: &[Vec<u8>]) {
    let at = random.usize(0..=input.len());
    // Most pieces are short.
    let longest = 1 << random.u8(0..9);
    let piece = 1 + random.usize(0..longest);
    let end = (at + piece).min(input.len());
    match random.u8(0..12) {
        0 if at < input.len() => input[at] ^= 1 << random.u8(0..8),
        1 if at < input.len() => input[at] = BYTES[random.usize(0..BYTES.len())],
        2 if at < input.len() => input[at] = random.u8(..),
        3 => insert(input, at, &[BYTES[random.usize(0..BYTES.len())]]),
        4 => drop(input.drain(at..end)),
        5 => {
            let copy = input[at..end].to_vec();
            let to = random.usize(0..=input.len());
            insert(input, to, &copy);
        }
        6 => {
            let other = &corpus[random.usize(0..corpus.len())];
            let from = random.usize(0..=other.len());
            let copy = other[from..(from + piece).min(other.len())].to_vec();
            insert(input, at, &copy);
        }
        7 | 8 => number(random, input, at),
        9 => lines(random, input),
        10 => {
            // A binary field of two, four or eight bytes.
            let value = [0, 1, u64::MAX, 1 << 31, 1 << 15, random.u64(..)][random.usize(0..6)];
            for (byte, new) in input[at..].iter_mut().zip(&value.to_le_bytes()[..1 << random.usize(1..4)]) {
                *byte = *new;
            }
        }
        _ => input.truncate(at.max(input.len() / 2)),
    }
}

fn insert(input: &mut Vec<u8>, at: usize, piece: &[u8]) {
    input.splice(at..at, piece.iter().copied());
}

/// Replaces the next number of a text.
fn number(random: &mut Rng, input: &mut Vec<u8>, at: usize) {
    let is_part = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'+' | b'e');
    let Some(start) = input[at..].iter().position(u8::is_ascii_digit).map(|i| at + i) else { return };
    let end = input[start..].iter().position(|b| !is_part(b)).map_or(input.len(), |i| start + i);
    let new = NUMBERS[random.usize(0..NUMBERS.len())];
    input.splice(start..end, new.bytes());
}

/// Removes, doubles or swaps lines.
fn lines(random: &mut Rng, input: &mut Vec<u8>) {
    let mut all: Vec<Vec<u8>> = input.split_inclusive(|&b| b == b'\n').map(<[u8]>::to_vec).collect();
    if all.len() < 2 {
        return;
    }
    let (a, b) = (random.usize(0..all.len()), random.usize(0..all.len()));
    match random.u8(0..3) {
        0 => drop(all.remove(a)),
        1 => all.insert(b, all[a].clone()),
        _ => all.swap(a, b),
    }
    *input = all.concat();
}
