//! Tests of the harness: broken parsers are detected, and the input is kept.

use super::harness::{fuzz, is_child};
use std::path::Path;

/// Fuzzes a reader that breaks on inputs with a byte of 7; gives what the harness says.
fn broken(name: &str, read: fn()) -> String {
    let reader = move |input: &[u8], _: &Path| {
        if input.contains(&7) {
            read();
        }
        String::new()
    };
    let seeds = || vec![vec![1, 2, 3], vec![5, 7, 9]];
    if is_child() {
        fuzz(name, seeds(), 100, reader);
        return String::new();
    }
    let fault =
        std::panic::catch_unwind(|| fuzz(name, seeds(), 100, reader)).expect_err("a broken reader passes");
    let said = fault.downcast_ref::<String>().cloned().unwrap_or_default();
    let kept = std::env::temp_dir().join(format!("fuzz-{name}"));
    let input = std::fs::read(&kept).expect("the input is kept");
    std::fs::remove_file(kept).expect("the kept input can be removed");
    assert!(input.contains(&7), "{input:?}");
    said
}

#[test]
fn a_panic() {
    let said = broken("caught::a_panic", || panic!("on purpose"));
    assert!(is_child() || said.contains("make it a test"), "{said}");
}

#[test]
fn an_allocation_without_measure() {
    let said = broken("caught::an_allocation_without_measure", || {
        drop(std::hint::black_box(vec![1_u8; 1 << 30]));
    });
    assert!(is_child() || said.contains("make it a test"), "{said}");
}
