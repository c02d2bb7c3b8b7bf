//! A range of seeds on the command line.

/// Most seeds of one run.
const MAX_SEEDS: u64 = 10_000;

/// Parses `A-B`, or one seed.
pub fn seed_range(text: &str) -> Result<(u64, u64), String> {
    let wrong = || format!("give the first and the last seed, up to {MAX_SEEDS} of them, as 100-199");
    let (from, to) = text.split_once('-').unwrap_or((text, text));
    let (from, to): (u64, u64) = from.parse().ok().zip(to.parse().ok()).ok_or_else(wrong)?;
    if from <= to && to - from < MAX_SEEDS { Ok((from, to)) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_range() {
        assert_eq!((seed_range("200-229"), seed_range("7")), (Ok((200, 229)), Ok((7, 7))));
        for wrong in ["", "a", "9-3", "0-10000", "1-2-3", "-5"] {
            assert!(seed_range(wrong).is_err(), "{wrong}");
        }
    }
}
