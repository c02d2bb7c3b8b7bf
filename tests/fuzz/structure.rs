//! Changes of texts that keep their structure: numbers, keys, lines, sections of TOML and YAML, elements of XML.

use fastrand::Rng;
use std::ops::Range;

/// Where the numbers of a text are: digits that no letter precedes.
fn numbers(text: &[u8]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < text.len() {
        let is_word = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
        if text[at].is_ascii_digit() && (at == 0 || !is_word(text[at - 1])) {
            let start = at - usize::from(at > 0 && text[at - 1] == b'-');
            let part = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'e' | b'E' | b'-' | b'+');
            at += text[at..].iter().position(|b| !part(b)).unwrap_or(text.len() - at);
            found.push(start..at);
        }
        at += 1;
    }
    found
}

/// A number near another one, of the same kind.
fn near(random: &mut Rng, old: &str) -> String {
    if let Ok(whole) = old.parse::<i64>() {
        let step = [-1, 1, 2, 10][random.usize(0..4)];
        return match random.u8(0..6) {
            0 => 0,
            1 => whole.saturating_neg(),
            2 => whole.saturating_mul(2),
            3 => whole / 2,
            _ => whole.saturating_add(step),
        }
        .to_string();
    }
    let Ok(value) = old.parse::<f64>() else { return "0".into() };
    let new = match random.u8(0..6) {
        0 => 0.0,
        1 => -value,
        2 => value * 10.0,
        3 => value * 0.1,
        _ => value * (0.9 + 0.2 * random.f64()),
    };
    format!("{new:?}")
}

/// Changes one number.
pub fn number(random: &mut Rng, text: &mut Vec<u8>) {
    let all = numbers(text);
    if all.is_empty() {
        return;
    }
    let range = all[random.usize(0..all.len())].clone();
    let old = String::from_utf8_lossy(&text[range.clone()]).into_owned();
    text.splice(range, near(random, &old).into_bytes());
}

/// A text in parts, each of which begins where `is_start` says so of a line.
fn parts(text: &[u8], is_start: fn(&[u8]) -> bool) -> Vec<Vec<u8>> {
    let mut parts: Vec<Vec<u8>> = Vec::new();
    for line in text.split_inclusive(|&b| b == b'\n') {
        match parts.last_mut() {
            Some(part) if !is_start(line) => part.extend(line),
            _ => parts.push(line.to_vec()),
        }
    }
    parts
}

/// Drops, doubles, swaps or takes over whole parts.
fn shuffle(random: &mut Rng, text: &mut Vec<u8>, other: &[u8], is_start: fn(&[u8]) -> bool) {
    let mut all = parts(text, is_start);
    let others = parts(other, is_start);
    if all.is_empty() || others.is_empty() {
        return;
    }
    let (a, b) = (random.usize(0..all.len()), random.usize(0..all.len()));
    let new = &others[random.usize(0..others.len())];
    match random.u8(0..5) {
        0 => drop(all.remove(a)),
        1 => all.insert(b, all[a].clone()),
        2 => all.swap(a, b),
        3 => all[a].clone_from(new),
        _ => all.insert(a, new.clone()),
    }
    *text = all.concat();
}

/// Swaps the values of two lines `key = value` or `key: value`.
fn values(random: &mut Rng, text: &mut Vec<u8>) {
    let mut lines = parts(text, |_| true);
    let at = |line: &Vec<u8>| line.iter().position(|b| matches!(b, b'=' | b':'));
    let keys: Vec<usize> = (0..lines.len()).filter(|&i| at(&lines[i]).is_some()).collect();
    if keys.len() < 2 {
        return;
    }
    let pick = |random: &mut Rng| keys[random.usize(0..keys.len())];
    let (a, b) = (pick(random), pick(random));
    let (Some(i), Some(j)) = (at(&lines[a]), at(&lines[b])) else { return };
    let (x, y) = (lines[a].split_off(i), lines[b].clone());
    if a == b {
        lines[a].extend(x);
        return;
    }
    lines[a].extend(&y[j..]);
    lines[b].truncate(j);
    lines[b].extend(x);
    *text = lines.concat();
}

/// Changes a text of lines: TOML, YAML, tables of numbers.
pub fn lines(random: &mut Rng, text: &mut Vec<u8>, other: &[u8]) {
    let section = |line: &[u8]| line.starts_with(b"[");
    // A key of the outermost map.
    let outer = |line: &[u8]| !line.starts_with(b" ") && !line.starts_with(b"-");
    match random.u8(0..10) {
        0..=4 => number(random, text),
        5 => shuffle(random, text, other, |_| true),
        6 => shuffle(random, text, other, section),
        7 => shuffle(random, text, other, outer),
        _ => values(random, text),
    }
}

/// The range of a random element of an XML text, with all that is in it.
fn element(random: &mut Rng, text: &[u8]) -> Option<Range<usize>> {
    let starts: Vec<usize> = text
        .windows(2)
        .enumerate()
        .filter(|(_, w)| w[0] == b'<' && (w[1].is_ascii_alphabetic() || w[1] == b'_'))
        .map(|(i, _)| i)
        .collect();
    let start = *starts.get(random.usize(0..starts.len().max(1)))?;
    let (mut depth, mut at) = (0_i32, start);
    while let Some(open) = text[at..].iter().position(|&b| b == b'<').map(|i| at + i) {
        let end = text[open..].iter().position(|&b| b == b'>').map(|i| open + i + 1)?;
        match (text.get(open + 1)?, text[end - 2]) {
            (b'/', _) => depth -= 1,
            (b'!' | b'?', _) | (_, b'/') => {}
            _ => depth += 1,
        }
        at = end;
        if depth <= 0 {
            return Some(start..end);
        }
    }
    None
}

/// Changes an XML text: numbers, and whole elements.
pub fn xml(random: &mut Rng, text: &mut Vec<u8>, other: &[u8]) {
    if random.u8(0..10) < 6 {
        return number(random, text);
    }
    let Some(range) = element(random, text) else { return };
    let piece = text[range.clone()].to_vec();
    match random.u8(0..4) {
        0 => drop(text.drain(range)),
        1 => drop(text.splice(range.start..range.start, piece)),
        2 => {
            if let Some(from) = element(random, other) {
                text.splice(range, other[from].iter().copied());
            }
        }
        _ => {
            if let Some(to) =
                element(random, text).filter(|to| to.end <= range.start || to.start >= range.end)
            {
                text.splice(to.start..to.start, piece);
            }
        }
    }
}
