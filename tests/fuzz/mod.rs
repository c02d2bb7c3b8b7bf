//! Every parser of external input, on randomly mutated inputs: no input may make it panic, run without end or take
//! memory out of proportion.
//!
//! Each format has a generator of valid inputs and changes that keep its structure ([`structure`], [`containers`]).
//! Two seconds for each reader with every commit; longer with
//! `LOOKOUT_FUZZ_SECONDS=600 cargo test --release -p lookout --test slow fuzz::`.

mod calibrations;
mod caught;
mod containers;
mod frames;
mod harness;
mod messages;
mod motion;
mod mutate;
mod networks;
mod pictures;
mod recordings;
mod structure;
mod texts;

fn text(input: &[u8]) -> String {
    String::from_utf8_lossy(input).into_owned()
}
